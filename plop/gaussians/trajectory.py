"""Trajectory files: Gaussians over time in one HDF5 file, any number of them in each frame.

Layout (schema 1; metres, world frame):

    /                               attributes: schema, units="m"
    /<group>/<frame>/means          [N, 3] float32    also quats [N, 4] wxyz, scales [N, 3], opacities [N]
    /<group>/<frame>/ids            [N] int64, lineage: the ancestor at frame 0
    /<group>/<frame>/sh             [N, K, 3] float32, only where it differs from the frame before;
                                    elsewhere the attribute sh_frame names the frame that holds it
    /<group>/<frame>/extra/<name>   further arrays of this frame

Groups are kinds of states, e.g. "states" of a rollout, "predicted" and "updated" of a filter.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import torch
from torch import Tensor

from plop.artifacts.atomic_hdf5 import AtomicHdf5
from plop.artifacts.hdf5_reader import Hdf5Reader
from plop.errors import PlopError
from plop.gaussians.state import Gaussians

TRAJECTORY_SCHEMA = 1
_FIELDS = ("means", "quats", "scales", "opacities")


class TrajectoryWriter(AtomicHdf5):
    """Write a trajectory; use as a context manager. The file appears when the block ends without error."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self.file.attrs.update(schema=TRAJECTORY_SCHEMA, units="m")
        self._last_sh: dict[str, tuple[int, Tensor]] = {}

    def append(self, group: str, frame: int, gaussians: Gaussians, **extra: Tensor | np.ndarray) -> None:
        """Add one frame to a group.

        Args:
            group: Kind of state, e.g. "states".
            frame: Index of the recording's frame; each may be written once per group.
            gaussians: N Gaussians.
            extra: Further arrays of this frame, any shape.

        Raises:
            PlopError: The frame is there already, or the disk is full.
        """
        if f"{group}/{frame}" in self.file:
            raise PlopError("A frame was written twice.", where=f"{self.path}:/{group}/{frame}")
        gaussians = gaussians.detach().to("cpu")
        node = self.file.create_group(f"{group}/{frame}")
        for name in _FIELDS:
            _store(node, name, getattr(gaussians, name).float().numpy())
        _store(node, "ids", gaussians.ids.long().numpy())
        self._store_sh(node, group, frame, gaussians.sh.float())
        for name, values in extra.items():
            array = values.detach().cpu().numpy() if isinstance(values, Tensor) else np.asarray(values)
            _store(node, f"extra/{name}", array)
        self.check()

    def _store_sh(self, node: h5py.Group, group: str, frame: int, sh: Tensor) -> None:
        last = self._last_sh.get(group)
        if last is not None and torch.equal(last[1], sh):
            node.attrs["sh_frame"] = last[0]
            return
        _store(node, "sh", sh.numpy())
        self._last_sh[group] = (frame, sh.clone())


def _store(node: h5py.Group, name: str, array: np.ndarray) -> None:
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if array.ndim and array.size else {}
    node.create_dataset(name, data=array, track_times=False, **packing)


class Trajectory(Hdf5Reader):
    """Read a trajectory, one frame at a time."""

    noun, schema, maker = "trajectory", TRAJECTORY_SCHEMA, "Run the stage that writes it"

    @property
    def groups(self) -> list[str]:
        """Kinds of states in the file, sorted."""
        return sorted(self._file)

    def frames(self, group: str) -> list[int]:
        """Frames of a group, ascending; empty for an unknown group."""
        return sorted(int(frame) for frame in self._file[group]) if group in self._file else []

    def read(self, group: str, frame: int) -> Gaussians:
        """Read one frame's Gaussians in float32.

        Raises:
            PlopError: There is no such frame, or it is incomplete.
        """
        node = self._node(group, frame)
        holder = self._node(group, int(node.attrs["sh_frame"])) if "sh_frame" in node.attrs else node
        arrays = {name: torch.from_numpy(self._array(node, name)) for name in (*_FIELDS, "ids")}
        return Gaussians(sh=torch.from_numpy(self._array(holder, "sh")), **arrays)

    def has_extra(self, group: str, frame: int, name: str) -> bool:
        """Return whether a frame has an extra array of this name."""
        return f"{group}/{frame}/extra/{name}" in self._file

    def extra(self, group: str, frame: int, name: str) -> Tensor:
        """Read an extra array of one frame.

        Raises:
            PlopError: There is no array of this name.
        """
        return torch.from_numpy(self._array(self._node(group, frame), f"extra/{name}"))

    def _node(self, group: str, frame: int) -> h5py.Group:
        if f"{group}/{frame}" not in self._file:
            frames = self.frames(group)
            known = f"frames {frames[0]} to {frames[-1]}" if frames else f"one of the groups {', '.join(self.groups)}"
            raise PlopError(
                "The trajectory has no such frame.",
                where=f"{self.path}:/{group}/{frame}",
                expected=known,
                found=f"frame {frame}",
            )
        return self._file[f"{group}/{frame}"]

    def _array(self, node: h5py.Group, name: str) -> np.ndarray:
        if name not in node:
            raise PlopError(
                "The trajectory is incomplete.",
                where=f"{self.path}:{node.name}/{name}",
                expected="this array",
                found=", ".join(node),
            )
        return np.asarray(node[name][()])
