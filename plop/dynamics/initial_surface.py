"""The object's closed surface in the first frame: its shape from fitted Gaussians, its place from measured depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.unseen_footprint import hidden_below
from plop.geometry.meshes.convex import convex_surface
from plop.geometry.view import View
from plop.metrics.clouds import back_project_all
from plop.recordings.recording import Recording

ON_SURFACE_M = 0.0015
"""Largest distance from a Gaussian on the surface to the measured points [m]."""
LEAST_POINTS = 40
"""Points and Gaussians below which there is no surface."""
_OPAQUE = 0.5
_ENOUGH = 20_000
"""About as many measured points tell where the faces lie; large images have fifty times more."""
_STRAY = 0.005
"""Share of the measured points farthest out that are taken for stray pixels."""


@dataclass(frozen=True)
class FirstFrame:
    """What the cameras measured of the object at the start."""

    views: list[View]
    points: np.ndarray
    """Measured places on the object, world, [K, 3] [m]; stray pixels left out."""
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
        """Tell which Gaussians are opaque and lie on the measured surface, bool [N]."""
        near = cKDTree(self.points).query(gaussians.means.detach().cpu().numpy())[0] < ON_SURFACE_M
        return np.asarray(near & (gaussians.opacities.detach().cpu().numpy() > _OPAQUE))

    def surface(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrap the object.

        A fit has averaged the noise of depth: the centres of its Gaussians show the shape; but all together they lie
        beside the surface, by half a millimetre where the fit is coarse, while the pixels do not, in the mean.

        Args:
            places: Centres of Gaussians on the surface, [M, 3] [m].

        Returns:
            Vertices [V, 3] [m] and outward triangles [F, 3].

        Raises:
            PlopError: The places enclose nothing.
        """
        rim = None
        if self.table_z_m is not None:
            rim = hidden_below(places, self.views, self.table_z_m)
        return convex_surface(places, self.table_z_m, self.points[:: -(-len(self.points) // _ENOUGH)], rim)


def first_surface(recording: Recording, gaussians: Gaussians) -> tuple[np.ndarray, np.ndarray] | None:
    """Wrap the object that fitted Gaussians and the first frame show; None where too little of it was measured."""
    try:
        frame = FirstFrame.of(recording)
        places = gaussians.means.detach().cpu().double().numpy()[frame.shown(gaussians)]
        return frame.surface(places) if len(places) >= LEAST_POINTS else None
    except PlopError:
        return None
