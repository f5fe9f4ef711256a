"""The processes of a training run: one by default, several under `torchrun`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import nn

from plop.errors import PlopError

Item = TypeVar("Item")


@dataclass(frozen=True)
class Processes:
    """This process in the group."""

    rank: int
    count: int
    device: torch.device
    """Device of this process."""

    @property
    def first(self) -> bool:
        """Whether this process writes."""
        return self.rank == 0

    @classmethod
    @contextmanager
    def join(cls, device: torch.device | str = "cpu") -> Iterator[Processes]:
        """Join the group started by `torchrun`; a single process without it.

        Args:
            device: Device of this process: CUDA uses NCCL, otherwise gloo.
        """
        device = torch.device(device)
        count = int(os.environ.get("WORLD_SIZE", "1"))
        if count == 1 or dist.is_initialized():
            yield cls(dist.get_rank(), dist.get_world_size(), device) if dist.is_initialized() else cls(0, 1, device)
            return
        if device.type == "cuda":
            torch.cuda.set_device(device)
        dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
        try:
            yield cls(dist.get_rank(), dist.get_world_size(), device)
        finally:
            dist.destroy_process_group()

    def wait(self) -> None:
        """Wait for all processes."""
        if self.count > 1:
            dist.barrier()

    def wrap(self, module: nn.Module) -> nn.Module:
        """Average gradients over the processes."""
        if self.count == 1:
            return module
        return nn.parallel.DistributedDataParallel(module, find_unused_parameters=True)

    def mean(self, value: float) -> float:
        """Average a number over the processes."""
        if self.count == 1:
            return value
        tensor = torch.tensor(value, device=self.device)
        dist.all_reduce(tensor)
        return float(tensor) / self.count


def share(items: Sequence[Item], processes: Processes) -> list[Item]:
    """Return this process's part of a batch; all parts have the same size.

    Raises:
        PlopError: The batch cannot be shared evenly.
    """
    if len(items) % processes.count:
        raise PlopError(
            "The batch cannot be shared evenly.",
            expected=f"a multiple of {processes.count} processes",
            found=f"batch {len(items)}",
            fix="Set train.batch to such a multiple.",
        )
    return list(items[processes.rank :: processes.count])
