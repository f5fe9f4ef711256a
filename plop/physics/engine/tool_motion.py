"""The rigid tool as the engine sees it: a thin blade or a convex solid, with a pose at every instant."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.meshes.convex import sides_of
from plop.geometry.meshes.tool import ToolGeometry

BLADE_ASPECT = 0.25
"""A tool whose smallest extent is a smaller share of its middle one is a blade: it parts what it passes. Any other
presses, however coarse the grid that it is seen through."""


class ToolKind(IntEnum):
    """How the tool touches; the values are what the kernels switch on."""

    NONE = 0
    BLADE = 1
    """A plane with an outline that separates two sides."""
    SOLID = 2
    """The convex hull of the mesh."""


@dataclass(frozen=True)
class ToolShape:
    """Flat arrays for the kernels, in the tool's principal frame (origin `center`, columns `axes`)."""

    kind: ToolKind
    center: np.ndarray
    """Origin of the principal frame in the tool's frame, [3] [m]."""
    axes: np.ndarray
    """Principal axes as columns in the tool's frame, [3, 3]; column 0 is a blade's normal."""
    faces: np.ndarray
    """Half-spaces a x + b y + c z <= d that hold inside, float32 [K, 4]; a = 0 for a blade's outline."""
    thickness: np.ndarray
    """Half thickness of a blade at (y, z): t0 + t1 y + t2 z, not below t3; float32 [4] [m]."""
    edges: np.ndarray
    """Cutting edge as points (y, z) and the length each stands for, float32 [E, 3] [m]."""

    @classmethod
    def from_mesh(cls, vertices: np.ndarray, faces: np.ndarray, kind: ToolKind | None = None) -> ToolShape:
        """Read a tool's shape off its mesh.

        Args:
            vertices: Shape [V, 3], tool frame, metres.
            faces: Shape [F, 3].
            kind: What the tool is taken for; its proportions tell when absent.
        """
        geometry = ToolGeometry.from_mesh(vertices, faces)
        kind = kind or kind_of(geometry)
        axes, center = _sign_fixed(geometry.axes.double().numpy()), geometry.center.double().numpy()
        local = (np.asarray(vertices, float) - center) @ axes
        if kind == ToolKind.SOLID:
            sides = _unlike_first(sides_of(ConvexHull(local))).astype(np.float32)
            return cls(ToolKind.SOLID, center, axes, sides, np.zeros(4, np.float32), np.zeros((0, 3), np.float32))
        flat = local[:, 1:]
        outline = flat[ConvexHull(flat).vertices]
        ahead = np.roll(outline, -1, 0) - outline
        normal = np.stack([ahead[:, 1], -ahead[:, 0]], 1) / np.linalg.norm(ahead, axis=1, keepdims=True)
        half = np.concatenate([np.zeros((len(outline), 1)), normal, (normal * outline).sum(1)[:, None]], 1)
        thickness = _fit_thickness(local)
        return cls(
            ToolKind.BLADE,
            center,
            axes,
            half.astype(np.float32),
            thickness.astype(np.float32),
            _thin_edges(outline, thickness).astype(np.float32),
        )


def _unlike_first(sides: np.ndarray) -> np.ndarray:
    """Order half-spaces [K, 4] so that each looks as far as can be from all before it.

    Most particles are far from the tool, and a few of these show it, however many faces a scanned tool has.
    """
    normals, order, nearest = sides[:, :3], [0], np.full(len(sides), -np.inf)
    while len(order) < len(sides):
        nearest = np.maximum(nearest, normals @ normals[order[-1]])
        nearest[order[-1]] = np.inf
        order.append(int(nearest.argmin()))
    return sides[order]


def kind_of(geometry: ToolGeometry) -> ToolKind:
    """Tell by its proportions what a tool is."""
    thinnest, middle, _ = geometry.half_extent.tolist()
    return ToolKind.BLADE if thinnest < BLADE_ASPECT * middle else ToolKind.SOLID


def _sign_fixed(axes: np.ndarray) -> np.ndarray:
    """Choose the signs of principal axes so that rounding cannot flip them: largest components positive."""
    signs = np.sign(axes[np.abs(axes).argmax(0), range(3)])
    fixed = axes * signs
    fixed[:, 2] *= np.sign(np.linalg.det(fixed))
    return np.asarray(fixed)


def _fit_thickness(local: np.ndarray) -> np.ndarray:
    """Fit the half thickness of a wedge to its vertices, linear over the blade's plane; [4] [m]."""
    terms = np.concatenate([np.ones((len(local), 1)), local[:, 1:]], 1)
    plane, *_ = np.linalg.lstsq(terms, np.abs(local[:, 0]), rcond=None)
    return np.append(plane, np.abs(local[:, 0]).min())


def _thin_edges(outline: np.ndarray, thickness: np.ndarray, spacing_m: float = 0.002) -> np.ndarray:
    """Sample the parts of the outline where the blade is thinnest; rows (y, z, length) [m]."""
    following = np.roll(outline, -1, 0)
    middle = (outline + following) / 2
    half = thickness[0] + middle @ thickness[1:3]
    sharp = half <= half.min() + 0.1 * max(np.ptp(half), 1e-9)
    rows = [np.zeros((0, 3))]
    for start, end in zip(outline[sharp], following[sharp], strict=True):
        length = float(np.linalg.norm(end - start))
        count = max(1, round(length / spacing_m))
        share = (np.arange(count) + 0.5)[:, None] / count
        rows.append(np.concatenate([start + share * (end - start), np.full((count, 1), length / count)], 1))
    return np.concatenate(rows)


@dataclass(frozen=True)
class ToolMotion:
    """A rigid tool's mesh and its pose over time."""

    vertices: np.ndarray
    """[V, 3], tool frame [m]."""
    faces: np.ndarray
    """[F, 3]."""
    times: np.ndarray
    """[T] [s], strictly increasing; before the first and after the last the tool rests."""
    world_from_tool: np.ndarray
    """[T, 4, 4]."""

    def __post_init__(self) -> None:
        times, poses = np.asarray(self.times), np.asarray(self.world_from_tool)
        if poses.shape != (len(times), 4, 4) or not np.isfinite(poses).all() or (np.diff(times) <= 0).any():
            raise PlopError(
                "The tool's motion cannot be used.",
                where="world_from_tool",
                expected="one finite 4x4 pose for each strictly increasing time",
                found=f"poses {poses.shape}, {len(times)} times",
                fix="Look for repeated times and poses of NaN in the recording.",
            )

    @cached_property
    def _rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity of the origin [m/s] and spin [rad/s] between two times, [T - 1, 3] each."""
        poses, span = self.world_from_tool, np.diff(self.times)[:, None]
        turn = poses[1:, :3, :3] @ np.swapaxes(poses[:-1, :3, :3], 1, 2)
        return np.diff(poses[:, :3, 3], axis=0) / span, Rotation.from_matrix(turn).as_rotvec() / span

    @property
    def shape(self) -> ToolShape:
        """The tool as the kernels see it; its arrays are shared."""
        vertices, faces = np.ascontiguousarray(self.vertices, float), np.ascontiguousarray(self.faces, np.int64)
        return _shape_of(vertices.tobytes(), faces.tobytes())

    def at(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Interpolate pose and velocity: straight for the origin, at constant spin for the rotation.

        Args:
            times_s: Shape [K] [s].

        Returns:
            world_from_tool [K, 4, 4], velocity of the tool's origin [K, 3] [m/s], angular velocity [K, 3] [rad/s].
        """
        wanted, times, poses = np.atleast_1d(np.asarray(times_s, float)), self.times, self.world_from_tool
        if len(times) < 2:
            still = np.zeros((len(wanted), 3))
            return np.tile(poses[0], (len(wanted), 1, 1)), still, still
        k = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
        since = np.clip(wanted, times[0], times[-1]) - times[k]
        moving = ((wanted >= times[0]) & (wanted < times[-1]))[:, None]
        velocity, spin = (rates[k] for rates in self._rates)
        out = np.tile(np.eye(4), (len(wanted), 1, 1))
        out[:, :3, :3] = Rotation.from_rotvec(spin * since[:, None]).as_matrix() @ poses[k, :3, :3]
        out[:, :3, 3] = poses[k, :3, 3] + velocity * since[:, None]
        return out, velocity * moving, spin * moving


@lru_cache(maxsize=16)
def _shape_of(vertices: bytes, faces: bytes) -> ToolShape:
    """Cached `ToolShape.from_mesh`: a diagnosis moves the same tool hundreds of times."""
    places, triangles = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int64).reshape(-1, 3)
    return ToolShape.from_mesh(places.copy(), triangles.copy())


def kernel_poses(shape: ToolShape, motion: ToolMotion, times_s: np.ndarray) -> np.ndarray:
    """Pack the principal frame at the given times for the kernels.

    Returns:
        float32 [K, 6, 3]: origin [m], the three axes in world, velocity of the origin [m/s], spin [rad/s].
    """
    pose, velocity, spin = motion.at(times_s)
    offset = pose[:, :3, :3] @ shape.center
    axes = np.swapaxes(pose[:, :3, :3] @ shape.axes, 1, 2)
    parts = [(pose[:, :3, 3] + offset)[:, None], axes, (velocity + np.cross(spin, offset))[:, None], spin[:, None]]
    return np.ascontiguousarray(np.concatenate(parts, 1), dtype=np.float32)
