"""Is the tool's mesh where its pose says? Measured depth against the drawn tool, whatever the masks say.

Masks may have been made from the mesh itself, so they are not asked. Where the tool is drawn and a farther surface is
measured, the tool was looked through: it cannot be there. Something nearer only hides it. Axes of the mesh (y up, x
forward, mirrored) are tried when much of it is looked through.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from plop.geometry.rigid import invert_rigid, transform_points
from plop.geometry.view import View
from plop.lazy_open3d import o3d
from plop.recordings.recording import Mesh

GATE_M, GATE_SHARE = 0.012, 0.01
"""The tool is measured when depth is this near [m], plus this share of the depth: poses of cameras and tool are good to
some millimetres, and a blade is a few millimetres thick."""
FEWEST_PX = 50
"""Pixels well inside the drawn tool, in all frames together, that must be judged."""
THROUGH = 0.6
"""More than this share looked through: the tool is elsewhere. A blade 50 mm high that is 10 mm off shows 0.2."""
FITS = 0.25
"""Less than this share looked through: the tool is there."""
MOST_PX, FEW_PX = 4000, 800
"""Rays cast at most in a view, and in each view of a search for other axes."""
SHIFT_M = 0.06
"""A mount is searched so far from where it is said to be, in each direction [m]."""
ABOVE_M = 0.015
"""What is measured lower than this above the table may be the table, and proves no tool [m]."""


@dataclass(frozen=True)
class ToolFit:
    """How much of the drawn tool is measured, over some frames of one camera."""

    measured_px: int
    through_px: int

    @property
    def judged_px(self) -> int:
        """Pixels of the drawn tool that tell something."""
        return self.measured_px + self.through_px

    @property
    def through(self) -> float | None:
        """Share that is looked through, 0 to 1; None when too little of the tool is seen."""
        return self.through_px / self.judged_px if self.judged_px >= FEWEST_PX else None

    def __add__(self, other: ToolFit) -> ToolFit:
        return ToolFit(self.measured_px + other.measured_px, self.through_px + other.through_px)


class ToolLook:
    """Casts the tool's mesh into views."""

    def __init__(self, mesh: Mesh, table_z_m: float | None = None) -> None:
        self._floor = -np.inf if table_z_m is None else table_z_m + ABOVE_M
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.vertices, np.float32)),
            o3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.faces, np.uint32)),
        )
        self._reach = float(np.linalg.norm(mesh.vertices, axis=1).max())

    def fit(
        self,
        views: Sequence[View],
        world_from_tool: Sequence[np.ndarray],
        axes: np.ndarray | None = None,
        most_px: int = MOST_PX,
        shift_m: np.ndarray | None = None,
    ) -> ToolFit:
        """Compare depth with the tool drawn at its poses.

        Args:
            views: Frames of one camera.
            world_from_tool: Pose at each of them, shape [4, 4] each.
            axes: Turn the mesh about its frame's origin first, shape [3, 3], perhaps mirrored.
            most_px: Rays cast in a view, at most about.
            shift_m: Then move the mesh in its frame, shape [3] [m].
        """
        total = ToolFit(0, 0)
        move = np.eye(4)
        move[:3, 3] = 0 if shift_m is None else shift_m
        for view, pose in zip(views, [pose @ move for pose in world_from_tool], strict=True):
            total += self._one(view, pose, np.eye(3) if axes is None else axes, most_px)
        return total

    def _one(self, view: View, pose: np.ndarray, axes: np.ndarray, most_px: int) -> ToolFit:
        box = self._window(view, pose)
        if box is None:
            return ToolFit(0, 0)
        step = max(1, int(np.sqrt((box[0].stop - box[0].start) * (box[1].stop - box[1].start) / most_px)))
        box = slice(box[0].start, box[0].stop, step), slice(box[1].start, box[1].stop, step)
        rays = view.camera.pixel_directions()[box]
        measured = view.depth_m[box]
        tool_from_cam = invert_rigid(pose) @ view.camera.world_from_cam
        packed = np.empty((*measured.shape, 6), np.float32)
        packed[..., :3] = axes.T @ tool_from_cam[:3, 3]
        packed[..., 3:] = rays @ (axes.T @ tool_from_cam[:3, :3]).T
        expected = self._scene.cast_rays(o3d.core.Tensor.from_numpy(packed), nthreads=1)["t_hit"].numpy()
        hit = np.isfinite(expected)
        inside = cv2.erode(hit.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0 if step == 1 else hit
        inside &= measured > 0
        farther = (measured - expected)[inside]
        gate = GATE_M + GATE_SHARE * expected[inside]
        pose_z = view.camera.world_from_cam[2]
        high = (rays @ pose_z[:3] * measured + pose_z[3])[inside] > self._floor
        weight = step**2
        return ToolFit(weight * int((high & (np.abs(farther) < gate)).sum()), weight * int((farther > gate).sum()))

    def _window(self, view: View, pose: np.ndarray) -> tuple[slice, slice] | None:
        """The part of the picture where the tool may be, however it is turned."""
        camera = view.camera
        middle = transform_points(camera.cam_from_world, pose[None, :3, 3])[0]
        if middle[2] < self._reach + 0.02:
            return slice(0, camera.height), slice(0, camera.width)
        k, reach = camera.intrinsics, self._reach / (middle[2] - self._reach)
        column, row = k[0, 0] * middle[0] / middle[2] + k[0, 2], k[1, 1] * middle[1] / middle[2] + k[1, 2]
        left, right = (int(np.clip(column + s * (reach * k[0, 0] + 2), 0, camera.width)) for s in (-1, 1))
        top, bottom = (int(np.clip(row + s * (reach * k[1, 1] + 2), 0, camera.height)) for s in (-1, 1))
        return (slice(top, bottom), slice(left, right)) if right - left > 2 and bottom - top > 2 else None

    def better_axes(self, frames: Sequence[tuple[Sequence[View], Sequence[np.ndarray]]]) -> Axes | None:
        """Search the axes of the mesh with which the tool is where depth shows something.

        Args:
            frames: Per camera its views and the tool's poses.

        Returns:
            The simplest of the best, when it clearly fits and the mesh as it is does not.
        """

        def total(axes: np.ndarray) -> ToolFit:
            return sum((self.fit(views, poses, axes, FEW_PX) for views, poses in frames), ToolFit(0, 0))

        here = total(np.eye(3))
        tried = [(axes, total(axes.matrix)) for axes in all_axes()]
        best = max(fit.measured_px - fit.through_px for _, fit in tried)
        axes, fit = next((a, f) for a, f in tried if f.measured_px - f.through_px >= best - 0.03 * abs(best))
        clear = fit.through is not None and fit.through < FITS and fit.measured_px > 1.5 * here.measured_px
        return axes if clear else None

    def better_place(self, frames: Sequence[tuple[Sequence[View], Sequence[np.ndarray]]]) -> np.ndarray | None:
        """Search how far the mesh must be moved in its frame [m] to be where depth shows something, shape [3].

        Returns:
            None when no place up to SHIFT_M away fits.
        """
        found = np.zeros(3)
        for step in (SHIFT_M / 3, SHIFT_M / 9):
            around = found + step * np.stack(
                np.meshgrid(*[np.arange(-3, 4) if step > 0.01 else np.arange(-2, 3)] * 3), -1
            ).reshape(-1, 3)
            scores = []
            for shift in around:
                fits = [self.fit(views, poses, None, FEW_PX // 4, shift) for views, poses in frames]
                scores.append(sum(f.measured_px - f.through_px for f in fits) - 10 * float(np.linalg.norm(shift)))
            found = around[int(np.argmax(scores))]
        here, there = (
            sum((self.fit(views, poses, None, FEW_PX, shift) for views, poses in frames), ToolFit(0, 0))
            for shift in (np.zeros(3), found)
        )
        clear = there.through is not None and there.through < FITS and there.measured_px > 3 * here.measured_px
        return found if clear else None


@dataclass(frozen=True)
class Axes:
    """Other axes for a mesh."""

    name: str
    matrix: np.ndarray
    """Vertices are multiplied by it, shape [3, 3]."""


def all_axes() -> Iterator[Axes]:
    """Give the 47 other axes, single turns first, mirrored ones last; each named by turns about fixed axes."""
    known = [np.eye(3)]
    single = [
        (f"turned by {angle:+d} deg about {axis}", _turn(axis, angle)) for axis in "xyz" for angle in (90, -90, 180)
    ]
    double = [(f"{a}, then by {b.split('by ')[1]}", n @ m) for a, m in single for b, n in single]
    for name, matrix in single + double:
        if not any(np.array_equal(matrix, other) for other in known):
            known.append(matrix)
            yield Axes(name, matrix)
    flip = np.diag([-1.0, 1.0, 1.0])
    for base in known:
        matrix = base @ flip
        flips = zip("xyz", np.eye(3), strict=True)
        axis = "".join(letter for letter, row in flips if np.array_equal(matrix, np.diag(1 - 2 * row)))
        yield Axes(f"mirrored along {axis}" if axis else "mirrored along x and turned", matrix)


def _turn(axis: str, angle: int) -> np.ndarray:
    c, s = round(np.cos(np.radians(angle))), round(np.sin(np.radians(angle)))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix
