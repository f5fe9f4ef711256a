"""Hand a recording on to the next stage: linked when nothing changed, copied and edited otherwise."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
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
    depth: dict[str, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    """Per "cameras/<id>" or "scan/<id>": recorded depth [H, W] [m] -> another; 0 (not measured) stays 0."""
    world_from_tool: np.ndarray | None = None
    """[T, 4, 4]"""
    tool_vertices: np.ndarray | None = None
    """[V, 3] [m]"""

    def __bool__(self) -> bool:
        tool = self.world_from_tool is not None or self.tool_vertices is not None
        return bool(self.intrinsics or self.poses or self.depth) or tool


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
        if edits.tool_vertices is not None:
            file["tool/mesh/vertices"][...] = edits.tool_vertices
        for key, change in edits.depth.items():
            depth = file[f"{key}/depth_m"]
            for frame in range(len(depth)):
                depth[frame] = change(np.nan_to_num(depth[frame], nan=0.0))
