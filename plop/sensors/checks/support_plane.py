"""The plane that the object rests on, seen by one camera alone: is it flat, level, and where the table is?

A plane n . X = d seen along the ray r (r_z = 1) has depth z with 1/z = (n . r)/d: inverse depth is linear in the image.
Distance along the ray, t = z |r|, is not: t makes 1/t = (n . r)/(d |r|), a bowl with a shape that has no parameter. So
1/depth = (a . r) |r|^-p is fitted, with p = 0 for depth and p = 1 for distance, and beside it a lens that bends the
picture, (x, y) -> (1 + k (x^2 + y^2)) (x, y). Pixels of the plane are found by random sampling in inverse depth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View

GATE_M, GATE_SHARE = 0.004, 0.01
"""A pixel lies on a plane when its depth is this near [m], plus this share of the depth."""
FEWEST_PX = 150
"""A plane needs so many pixels, a tenth of the picture's measured background at least."""
RESTS_M = 0.012
"""The object rests on a plane when some of it comes this near: what depth noise and smeared edges leave between."""
NEAR_M = 0.05
"""Object within this height above a plane is its support even where the foot is hidden."""
WARP_SHARE = 0.004
"""Depth cameras bend a flat wall by this share of the distance, smoothly; no bend below it counts (stereo and time of
flight: 0.2 to 0.5 % after factory calibration)."""
FAR_OFF_DEG, FAR_OFF_M = 15.0, 0.06
"""A table seen further off than this is no inaccurate pose: pictures or poses are of another kind."""
PIECES = 6
"""The picture is cut into PIECES x PIECES, whose errors are taken as independent."""


@dataclass(frozen=True)
class Bend:
    """How the surface bends in the way that distances along the ray would make it."""

    p: float
    """1 for distance along the ray, 0 for depth, -1 for depth that was divided by the ray's length."""
    error: float
    """Standard error of p, with what a sensor's own warp can do."""
    by_mm: float
    """What p = 1 bends the seen part of the plane by, root mean square [mm]."""
    lens_fits: float
    """Misfit left by a bent lens over the one left by p; well below 1 when it is rather the lens."""

    @property
    def tells(self) -> bool:
        """Whether depth and distance can be told apart at all on what is seen."""
        return self.error < 0.25

    @property
    def distance(self) -> bool:
        """Whether these are distances along the ray: far from 0, and 1 as well as it can be told."""
        return self.tells and self.p > 4 * self.error and abs(self.p - 1) < max(0.25, 3 * self.error)

    @property
    def curved(self) -> bool:
        """Whether a plane is seen bent as neither depth nor distance bends it."""
        return self.tells and abs(self.p) > max(0.5, 5 * self.error) and not self.distance


@dataclass(frozen=True)
class Support:
    """The plane around the object, in the world."""

    height_m: float
    """World z under the object's middle [m]."""
    tilt_deg: float
    """Against the world's horizontal [deg]."""
    rms_mm: float
    """Depth about the plane [mm]."""
    pixels: int
    share: float
    """Of the background around the object."""
    rests: bool
    """Whether the object touches it."""
    bend: Bend

    def is_far(self, table_z_m: float) -> bool:
        """Whether what the object rests on cannot be a table at this height, whatever is inaccurate."""
        return self.rests and (abs(self.height_m - table_z_m) > FAR_OFF_M or self.tilt_deg > FAR_OFF_DEG)


def find_support(view: View, *, as_distance: bool = False) -> Support | None:
    """Find the plane that most of the background around the object shows.

    Args:
        view: One frame of one camera.
        as_distance: Read depth as distance along the ray.

    Returns:
        None where there is no object, or no plane.
    """
    keep, near = _background(view)
    rays = view.camera.pixel_directions()
    length = np.linalg.norm(rays, axis=-1)
    depth = (view.depth_m / length if as_distance else view.depth_m).astype(np.float64)
    if not (view.object_mask & (depth > 0)).any():
        return None
    found = None
    for where in (near, keep):
        rows, columns = np.nonzero(where)
        if len(rows) < FEWEST_PX:
            continue
        found = _plane(rays[rows, columns], depth[rows, columns], length[rows, columns])
        if found is not None:
            break
    if found is None:
        return None
    plane, power = found
    with np.errstate(divide="ignore", invalid="ignore"):
        on = length ** float(power) / (rays @ plane)
        everywhere = keep & (np.abs(on - depth) < 2 * (GATE_M + GATE_SHARE * depth))
    if everywhere.sum() < max(FEWEST_PX, 0.1 * keep.sum()):
        return None
    share = float(everywhere.sum() / max(keep.sum(), 1))
    return _described(view.camera, rays, depth, view.object_mask, everywhere, share)


def turned(view: View, turns: int, mirrored: bool) -> View:
    """Give a view as if its pictures had been turned by quarter turns, after being mirrored left to right."""

    def change(picture: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.rot90(picture[:, ::-1] if mirrored else picture, turns))

    return replace(view, rgb=change(view.rgb), depth_m=change(view.depth_m), mask=change(view.mask))


def _background(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Background with depth, and the part of it around the object; bool [H, W] each."""
    other = (view.mask != MaskLabel.BACKGROUND).astype(np.uint8)
    keep = (cv2.dilate(other, np.ones((3, 3), np.uint8)) == 0) & (view.depth_m > 0)
    rows, columns = np.nonzero(view.object_mask)
    near = np.zeros_like(keep)
    if len(rows):
        size = max(np.ptp(rows), np.ptp(columns), 0.1 * view.camera.width)
        top, bottom = int(max(rows.min() - size, 0)), int(rows.max() + size + 1)
        left, right = int(max(columns.min() - size, 0)), int(columns.max() + size + 1)
        near[top:bottom, left:right] = keep[top:bottom, left:right]
    return keep, near


def _plane(rays: np.ndarray, depth: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Find a plane that most pixels show (RANSAC): a with |ray|^power / depth = a . ray, and the power: 0, 1, -1."""
    generator = np.random.default_rng(0)
    pick = generator.permutation(len(depth))[:800]
    r, gate = rays[pick], GATE_M + GATE_SHARE * depth[pick]
    best, most = None, 0.35 * len(pick)
    for power in (0, 1, -1):
        y = length[pick] ** float(power) / depth[pick]
        triples = generator.integers(0, len(pick), (150, 3))
        triples = triples[np.abs(np.linalg.det(r[triples])) > 1e-6]
        planes = np.linalg.solve(r[triples], y[triples][..., None])[..., 0]
        with np.errstate(divide="ignore"):
            inside = np.abs(length[pick] ** float(power) / (planes @ r.T) - depth[pick]) < gate
        counts = inside.sum(1) if len(planes) else np.zeros(1)
        i = int(counts.argmax())
        # a distance must explain clearly more than depth, which it does where it is right
        if counts[i] > (1.05 if best is not None else 1.0) * most:
            best, most = (np.linalg.lstsq(r[inside[i]], y[inside[i]], rcond=None)[0], power), counts[i]
    return best


def _described(
    camera: Camera, rays: np.ndarray, depth: np.ndarray, thing: np.ndarray, on: np.ndarray, share: float
) -> Support:
    where = np.nonzero(on)
    r, z = rays[on], depth[on]
    pieces = (where[0] * PIECES // depth.shape[0]) * PIECES + where[1] * PIECES // depth.shape[1]
    plane = _linear(r, z)
    for _ in range(3):
        # the foot of what stands on it, and smeared outlines, are within the gate, too
        residual = z - 1 / (r @ plane)
        usual = max(3.7 * float(np.median(np.abs(residual - np.median(residual)))), 1e-3)
        plane = _linear(r[np.abs(residual) < usual], z[np.abs(residual) < usual]) if usual < 0.1 else plane
    residual = z - 1 / (r @ plane)
    own = rays[thing & (depth > 0)] * depth[thing & (depth > 0)][:, None]
    # a . X = 1 on the plane, below 1 on the camera's side of it
    above = (1 - own @ plane) / np.linalg.norm(plane)
    middle = np.median(own, axis=0)
    normal = camera.world_from_cam[:3, :3] @ plane / np.linalg.norm(plane)
    eye = camera.world_from_cam[:3, 3]
    offset = normal @ eye + 1 / np.linalg.norm(plane)
    if normal[2] < 0:
        normal, offset = -normal, -offset
    world = camera.world_from_cam[:3, :3] @ middle + eye
    tilt = float(np.degrees(np.arccos(np.clip(normal[2], -1, 1))))
    # measured along the normal, so that a plane on end has a height, too
    height = world[2] + offset - normal @ world if tilt > 60 else (offset - normal[:2] @ world[:2]) / normal[2]
    low = float(np.percentile(above, 2))
    return Support(
        float(height),
        tilt,
        float(1e3 * np.sqrt((residual**2).mean())),
        len(z),
        share,
        bool(abs(low) < RESTS_M or -RESTS_M < low < NEAR_M and np.percentile(above, 98) < 5 * NEAR_M),
        _bend(r, z, pieces),
    )


def _bend(rays: np.ndarray, depth: np.ndarray, pieces: np.ndarray) -> Bend:
    """Fit p by Gauss-Newton; errors by pieces of the picture, and the lens instead of p."""
    log_length = np.log(np.linalg.norm(rays, axis=1))
    p, error, by = 0.0, np.inf, 0.0
    rest = np.inf
    for _ in range(4):
        # depth * |ray|^p of the plane that fits now
        r, z = rays, depth / np.exp(p * log_length) if p else depth
        step, error, by, rest = _extended(r, z, -(r @ _linear(r, z)) * log_length, pieces)
        p = float(np.clip(p + step, -3, 3))
    squared = (rays[:, :2] ** 2).sum(1)
    plane0 = _linear(rays, depth)
    lens = _extended(rays, depth, (rays[:, :2] @ plane0[:2]) * squared, pieces)[3]
    middle = float(np.median(depth))
    error = float(np.hypot(error, WARP_SHARE * middle / by)) if by > 0 else np.inf
    return Bend(p, error, 1e3 * by, float(lens / rest) if rest > 0 else 1.0)


def _linear(rays: np.ndarray, depth: np.ndarray) -> np.ndarray:
    weight = depth**2
    return np.linalg.lstsq(rays * weight[:, None], depth, rcond=None)[0]


def _extended(
    rays: np.ndarray, depth: np.ndarray, column: np.ndarray, pieces: np.ndarray
) -> tuple[float, float, float, float]:
    """Fit 1/depth = a . ray + q column; gives q, its error, what q = 1 changes in depth [m], and the misfit."""
    weight = depth**2
    r, y = rays * weight[:, None], depth
    c = column * weight
    own = c - r @ np.linalg.lstsq(r, c, rcond=None)[0]
    size = float((own**2).sum())
    if size < 1e-18:
        return 0.0, np.inf, 0.0, np.inf
    rest = y - r @ np.linalg.lstsq(r, y, rcond=None)[0]
    q = float((own * rest).sum() / size)
    left = rest - q * own
    score = np.bincount(pieces, own * left)
    return q, float(np.sqrt((score**2).sum()) / size), float(np.sqrt(size / len(c))), float((left**2).mean())
