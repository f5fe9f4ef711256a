"""Hand a recording on: linked when nothing changed, copied and corrected otherwise."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from plop.artifacts.atomic_file import scratch_of


@dataclass
class Edits:
    """What changes in one recording."""

    intrinsics: dict[str, np.ndarray] = field(default_factory=dict)
    """Per "cameras/<id>" or "scan/<id>": K, shape [3, 3] [px]."""
    poses: dict[str, np.ndarray] = field(default_factory=dict)
    """Per "cameras/<id>" or "scan/<id>": world_from_cam, shape [T, 4, 4]."""
    depth_factors: dict[str, float] = field(default_factory=dict)
    """Per "cameras/<id>" or "scan/<id>"."""
    world_from_tool: np.ndarray | None = None
    """[T, 4, 4]"""

    def __bool__(self) -> bool:
        return bool(self.intrinsics or self.poses or self.depth_factors or self.world_from_tool is not None)


def pass_on(source: Path, target: Path, edits: Edits) -> None:
    """Give a recording to the next stage, whole or not at all; the source is never touched.

    Args:
        source: Recording that exists.
        target: Path of the new one; replaced if it is there.
        edits: Empty: the file is hard-linked, or copied where the file system cannot link.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    scratch = scratch_of(target)
    scratch.unlink(missing_ok=True)
    if edits:
        shutil.copyfile(source, scratch)
        _edit(scratch, edits)
    else:
        try:
            os.link(source, scratch)
        except OSError:
            shutil.copyfile(source, scratch)
    target.unlink(missing_ok=True)
    os.replace(scratch, target)


def _edit(path: Path, edits: Edits) -> None:
    with h5py.File(path, "r+") as file:
        for key, matrix in edits.intrinsics.items():
            file[f"{key}/intrinsics"][...] = matrix
        for key, poses in edits.poses.items():
            file[f"{key}/world_from_cam"][...] = poses
        if edits.world_from_tool is not None:
            file["tool/world_from_tool"][...] = edits.world_from_tool
        for key, factor in edits.depth_factors.items():
            depth = file[f"{key}/depth_m"]
            for frame in range(len(depth)):
                depth[frame] = np.nan_to_num(depth[frame], nan=0.0) * np.float32(factor)
