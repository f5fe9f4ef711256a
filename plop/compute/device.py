"""Where tensors live: on the CPU or on a CUDA device."""

from __future__ import annotations

import os

import torch

from plop.errors import PlopError


def jobs_on(wanted: str, jobs: int) -> int:
    """Return the number of processes per device: one for a GPU, given as in `chosen_device`, else `jobs`."""
    return jobs if chosen_device(wanted).type == "cpu" else 1


def chosen_device(wanted: str) -> torch.device:
    """Return the device of a setting; under `torchrun` each process of a machine takes a CUDA device of its own.

    Args:
        wanted: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one.

    Raises:
        PlopError: The name is unknown, or there is no such device.
    """
    if wanted == "auto":
        wanted = "cuda" if torch.cuda.is_available() else "cpu"
    kind, _, number = wanted.partition(":")
    if kind not in ("cpu", "cuda") or (number and not number.isdigit()):
        raise PlopError("There is no such device.", expected="auto, cpu, cuda or cuda:<number>", found=wanted)
    if kind == "cpu":
        return torch.device("cpu")
    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    index = int(number or os.environ.get("LOCAL_RANK", "0"))
    if index >= count:
        raise PlopError(
            "There is no such CUDA device.",
            expected=f"{wanted}, number {index}",
            found=f"{count} CUDA devices",
            fix="Use --device cpu, or omit the option; `plop doctor` shows the devices that torch finds.",
        )
    return torch.device("cuda", index)
