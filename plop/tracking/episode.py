"""One measured episode as input of a diagnosis: tracked points, the tool, and the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2

from plop.errors import PlopError
from plop.geometry.meshes.convex import convex_surface
from plop.physics.engine.tool_motion import ToolMotion
from plop.recordings.readers.mesh.sequence import MeshSequence, begun_at_rest

POINTS = 400
"""Number of tracked points of one episode."""
PATCHES = 48
"""Number of groups of neighbouring points whose mean motion is compared."""


@dataclass(frozen=True)
class Episode:
    """Points of the object's surface, tracked from the first frame; M points, T frames."""

    name: str
    times: np.ndarray
    """[T] [s]; the first is the start."""
    points: np.ndarray
    """Measured positions, [T, M, 3] [m], world frame."""
    noise_m: float
    """Standard deviation of one coordinate of a measured point [m]."""
    patch: np.ndarray
    """Patch of every point, [M], 0 .. K-1; the points of a patch are neighbours on the same side of the cut."""
    tool: ToolMotion
    table_z_m: float | None
    vertices: np.ndarray
    """Closed surface of the object at the first frame, [V, 3] [m]."""
    faces: np.ndarray
    """Its triangles, [F, 3]."""

    seen: np.ndarray | None = None
    """Whether a point is visible, [T, M] bool; all when absent. A tracker extrapolates points hidden by the tool."""

    def __post_init__(self) -> None:
        frames, count = len(self.times), len(self.patch)
        if self.points.shape != (frames, count, 3) or frames < 3 or not np.isfinite(self.points).all():
            raise PlopError(
                "An episode cannot be compared.",
                where=self.name,
                expected="at least 3 frames of finite points",
                found=f"points {self.points.shape}",
                fix="Leave this episode out.",
            )

    @property
    def patches(self) -> int:
        """Number of patches K."""
        return int(self.patch.max()) + 1

    def pooled(self, values: np.ndarray) -> np.ndarray:
        """Average a quantity of the points over each patch, [..., M, 3] -> [..., K, 3]."""
        share = np.zeros((self.patches, len(self.patch)))
        share[self.patch, np.arange(len(self.patch))] = 1
        return np.asarray((share / share.sum(1, keepdims=True)) @ values)

    @property
    def seen_patches(self) -> np.ndarray:
        """Whether most of a patch's points are visible, [T, K]."""
        if self.seen is None:
            return np.ones((len(self.times), self.patches), bool)
        counts = np.stack([np.bincount(self.patch, row, self.patches) for row in self.seen.astype(float)])
        return counts > 0.5 * np.bincount(self.patch, minlength=self.patches)

    @property
    def motion(self) -> np.ndarray:
        """Displacement of the patches since the first frame, [T, K, 3] [m]."""
        return self.pooled(self.points - self.points[:1])

    @property
    def patch_noise_m(self) -> np.ndarray:
        """Standard deviation of one coordinate of a patch's displacement, [K] [m]."""
        counts = np.bincount(self.patch, minlength=self.patches)
        return self.noise_m * np.sqrt(2 / counts)


def patches_of(start: np.ndarray, end: np.ndarray, count: int = PATCHES) -> np.ndarray:
    """Group points that are neighbours at the first and the last frame: a cut separates patches.

    Args:
        start: Positions at the first frame, [M, 3] [m].
        end: Positions at the last frame, [M, 3] [m].
        count: Number of patches.

    Returns:
        Patch of every point, [M]; every patch has at least one point.
    """
    count = max(1, min(count, len(start) // 4))
    drift = end - start
    _, label = kmeans2(np.concatenate([start, drift - drift.mean(0)], 1), count, seed=0, minit="++")
    return np.unique(label, return_inverse=True)[1]


def episode_from_sequence(
    sequence: MeshSequence, *, noise_m: float, seed: int = 0, points: int = POINTS, name: str | None = None
) -> Episode:
    """Sample points of a simulated surface, with noise, as an ideal tracker would return them.

    Faces exposed only by the cut are left out, as no camera sees them at the start.

    Args:
        sequence: The episode.
        noise_m: Standard deviation of the noise of one coordinate [m].
        seed: Seed of points and noise.
        points: Number of points.
        name: Name of the episode, if it differs from the sequence's.
    """
    sequence = begun_at_rest(sequence)
    generator = np.random.default_rng([seed, 71])
    used, inner = np.unique(sequence.faces), np.unique(sequence.faces[sequence.is_cut_face])
    outer = np.setdiff1d(used, inner)
    chosen = generator.choice(outer, min(points, len(outer)), replace=False)
    exact = sequence.vertices[:, chosen].astype(np.float64)
    measured = exact + generator.normal(0, noise_m, exact.shape)
    tool = ToolMotion(sequence.tool_vertices, sequence.tool_faces, sequence.times, sequence.world_from_tool)
    vertices, faces = convex_surface(sequence.vertices[0, outer])
    return Episode(
        name or sequence.name,
        np.asarray(sequence.times, float),
        measured,
        noise_m,
        patches_of(exact[0], exact[-1]),
        tool,
        sequence.table_z_m,
        vertices,
        faces,
    )
