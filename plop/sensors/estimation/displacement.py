"""How far parameters of sensors move the object's points: the only measure of a fault."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from plop.geometry.rigid import transform_points
from plop.sensors.estimation.camera_frames import CameraScene
from plop.sensors.estimation.parameters import SLICES, TOTAL


@dataclass(frozen=True)
class Displacement:
    """What turns parameters into motion of the object's points in one camera."""

    squared: np.ndarray
    """Quadratic form [19, 19]: mean square over points and frames [m^2]. What cancels on the object counts nothing."""
    pixel_m: float
    """Width of a pixel at the object [m]."""

    def root(self, deviation: np.ndarray) -> float:
        """Root mean square displacement under deviations [19] from 'absent' [m]."""
        return float(np.sqrt(max(deviation @ self.squared @ deviation, 0.0)))


def displacement(scene: CameraScene) -> Displacement:
    """Give the displacement of the object of a scene, at rest at its place.

    The tool's speed stands for the object's; whatever is wrong with the tool moves it against the object.
    """
    first = scene.sightings[0].view.camera
    middle = transform_points(first.cam_from_world, scene.middle)
    shares = np.array([sighting.share for sighting in scene.sightings])
    squared = displacement_form(middle, scene.reach_m, scene.tool.speed_m_s if scene.tool else 0.0, shares)
    return Displacement(squared, float(middle[2] / first.intrinsics[0, 0]))


def displacement_form(middle_cam: np.ndarray, reach_m: float, tool_speed_m_s: float, shares: np.ndarray) -> np.ndarray:
    """Give the quadratic form of `Displacement`.

    Args:
        middle_cam: Middle of the object in the camera's axes, shape [3] [m].
        reach_m: Half the object's diagonal [m].
        tool_speed_m_s: Root mean square speed of the tool [m/s].
        shares: Shares of the episode that have passed at the frames [F].

    Returns:
        Shape [19, 19] [m^2].
    """
    around = middle_cam + 0.6 * reach_m * np.concatenate([np.eye(3), -np.eye(3)])
    x, y, z = around.T
    zero = np.zeros(len(around))
    turn = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    six = np.concatenate([np.tile(-np.eye(3), (len(around), 1, 1)), turn], -1)
    moved = np.zeros((len(shares), len(around), 3, TOTAL))
    moved[..., SLICES["pose_error"]] = six
    moved[..., SLICES["pose_drift"]] = shares[:, None, None, None] * six
    moved[..., SLICES["depth_scale"].start] = around
    moved[..., SLICES["depth_bias"].start] = around / around[:, 2:]
    rows = moved.reshape(-1, TOTAL)
    squared = rows.T @ rows / (len(shares) * len(around))
    squared[SLICES["clock"], SLICES["clock"]] = tool_speed_m_s**2
    for name in ("tool_offset", "tool_thickness"):
        squared[SLICES[name], SLICES[name]] = np.eye(SLICES[name].stop - SLICES[name].start)
    return np.asarray(squared)


def misfit(values: np.ndarray, covariance: np.ndarray, squared: np.ndarray, tolerance_m: float) -> float:
    """Give the chi-square between an estimate and the nearest parameters that displace by no more than a tolerance.

    Least (p - values)' covariance^-1 (p - values) under p' squared p <= tolerance^2: a ball in the displacement, an
    ellipsoid of confidence in the parameters, and how large it must grow to touch the ball.

    Args:
        values: Estimate [N].
        covariance: Shape [N, N].
        squared: Displacement as a quadratic form [N, N] [m^2].
        tolerance_m: Root mean square displacement that does not matter [m].
    """
    root = np.linalg.cholesky(covariance)
    sizes, axes = np.linalg.eigh(root.T @ squared @ root)
    sizes, place = np.maximum(sizes, 0.0), axes.T @ np.linalg.solve(root, values)

    def beyond(log_price: float) -> float:
        return float((sizes * (place / (1 + np.exp(log_price) * sizes)) ** 2).sum() - tolerance_m**2)

    if beyond(-np.inf) <= 0:
        return 0.0
    price = np.exp(brentq(beyond, -60.0, 60.0 - np.log(sizes.max())))
    return float(((price * sizes / (1 + price * sizes) * place) ** 2).sum())
