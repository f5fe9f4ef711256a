"""The object's closed surface in the first frame: its shape from fitted Gaussians, its position from measured depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.unseen_footprint import unseen_footprint
from plop.geometry.meshes.convex import convex_surface
from plop.geometry.view import View
from plop.metrics.clouds import back_project_all
from plop.recordings.recording import Recording

ON_SURFACE_M = 0.0015
"""Largest distance from a Gaussian on the surface to the measured points [m]."""
LEAST_POINTS = 40
"""Smallest number of points and of Gaussians for a surface."""
_OPAQUE = 0.5
_ENOUGH = 20_000
"""Number of measured points to use: enough to locate the faces; large images have fifty times more."""
_STRAY = 0.005
"""Share of the outermost measured points that is discarded as outliers."""


@dataclass(frozen=True)
class FirstFrame:
    """Measurement of the object at the first frame."""

    views: list[View]
    points: np.ndarray
    """Measured positions on the object, world, [K, 3] [m]; outliers discarded."""
    table_z_m: float | None

    @classmethod
    def of(cls, recording: Recording) -> FirstFrame:
        """Read the first frame.

        Raises:
            PlopError: Too few pixels show the object.
        """
        views = [recording.view(name, 0) for name in recording.camera_names]
        cloud = back_project_all(views)
        if len(cloud) < LEAST_POINTS:
            raise PlopError(
                "The first frame shows no object.",
                where=recording.path,
                expected="depth on the object's mask",
                found=f"{len(cloud)} points",
                fix="Check masks and depth: `plop calibrate`.",
            )
        distance = np.linalg.norm(cloud.points - np.median(cloud.points, 0), axis=1)
        return cls(views, cloud.points[distance <= np.quantile(distance, 1 - _STRAY)], recording.table_z_m)

    def shown(self, gaussians: Gaussians) -> np.ndarray:
        """Return which Gaussians are opaque and lie on the measured surface, bool [N]."""
        near = cKDTree(self.points).query(gaussians.means.detach().cpu().numpy())[0] < ON_SURFACE_M
        return np.asarray(near & (gaussians.opacities.detach().cpu().numpy() > _OPAQUE))

    def surface(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrap the object.

        A fit averages the noise of depth, so the centres of its Gaussians give the shape; but they have a common offset
        from the surface, half a millimetre for a coarse fit, while the pixels have none on average.

        Args:
            places: Centres of Gaussians on the surface, [M, 3] [m].

        Returns:
            Vertices [V, 3] [m] and outward triangles [F, 3].

        Raises:
            PlopError: The points enclose no volume.
        """
        rim = None
        if self.table_z_m is not None:
            rim = unseen_footprint(places, self.views, self.table_z_m)
        return convex_surface(places, self.table_z_m, self.points[:: -(-len(self.points) // _ENOUGH)], rim)


def initial_surface(recording: Recording, gaussians: Gaussians) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the surface of the object from fitted Gaussians and the first frame; None if too little was measured."""
    try:
        frame = FirstFrame.of(recording)
        places = gaussians.means.detach().cpu().double().numpy()[frame.shown(gaussians)]
        return frame.surface(places) if len(places) >= LEAST_POINTS else None
    except PlopError:
        return None
