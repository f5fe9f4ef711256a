"""Cameras whose pose cannot be right: find the convention, or the unit of depth, in which it would be.

The judge is the table. A camera that sees the workspace sees a horizontal plane at the table's height, from above. A pose
under which none of the largest planes of its depth is one is wrong. Read in another convention, the same six numbers put
a plane there within TILT_DEG and HEIGHT_M by chance once in some thousand times, so what does is named. It is never
applied: a name tells the user what to correct in the data, for every program that reads them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from plop.causes import Cause
from plop.errors import PlopError
from plop.geometry.plane import Plane, find_plane
from plop.geometry.pose_conventions import readings_of
from plop.geometry.rigid import transform_points
from stages.ingest.masks import Picture

LOOSE_DEG, LOOSE_M = 10.0, 0.06
"""A camera whose plane is nearer to the table than this is not accused: worse than any calibration error that
`plop calibrate` corrects (5 deg, 5 cm)."""
TILT_DEG, HEIGHT_M = 4.0, 0.025
"""A reading under which the plane is nearer than this puts the camera right: real poses of DROID are 1 to 2 deg off."""
APART_M = 0.04
"""How far the cameras' tables may lie apart where no table_z is given, twice HEIGHT_M less what both share [m]."""
SMALLEST_PLANE = 0.08
"""A plane that holds a smaller share of a camera's points is not looked at."""
IN_WORKSPACE = 0.05
"""Smallest share of a camera's points in the workspace, on or above its table."""
NEAR_M = 0.02
"""Points of two cameras nearer than this are of one surface [m]."""
DEPTH_UNITS = {
    0.1: "0.1 mm (RealSense D405)", 0.2: "0.2 mm (1/5000 m, TUM)", 0.25: "0.25 mm (RealSense L515)",
    10.0: "cm", 1000.0: "m", 0.001: "um",
}  # fmt: skip
"""Millimetres a count -> the unit's name."""


@dataclass(frozen=True)
class _Look:
    """What a camera measured, in its own axes."""

    points: np.ndarray
    """Shape [N, 3] [m]."""
    planes: list[tuple[Plane, np.ndarray]]
    """The largest planes and the middle of each one's points [m]."""


@dataclass(frozen=True)
class _Guess:
    """One way to read the data of a camera."""

    name: str
    pose: np.ndarray
    scale: float = 1.0
    departures: int = 0


@dataclass(frozen=True)
class _Fit:
    """How a guess puts a camera's table."""

    tilt_deg: float
    height_m: float
    in_workspace: float
    cloud: np.ndarray
    """Points above the table in the workspace, shape [N, 3]."""


def check_conventions(
    pictures: Mapping[str, Picture], stored: Mapping[str, np.ndarray], workspace: np.ndarray,
    table_z_m: float | None, episode: str,
) -> None:  # fmt: skip
    """Refuse cameras that another convention, or another unit of depth, puts right.

    Args:
        pictures: First picture of each camera.
        stored: Their poses as stored, [x, y, z, a, b, c] each.
        workspace: Lowest and highest corner, shape [2, 3] [m].
        table_z_m: Height of the table where the user gave it [m].
        episode: Name for the message.

    Raises:
        PlopError: Names the cameras and what to read differently. A camera that nothing puts right passes.
    """
    looks = {name: _look(picture) for name, picture in pictures.items() if name in stored}
    own = {name: _Guess("", pictures[name].camera.world_from_cam) for name in looks}
    wrong = [name for name, look in looks.items() if look.planes and not _loose(look, own[name], workspace, table_z_m)]
    if not wrong:
        wrong = _apart(looks, own, workspace, table_z_m)
    if not wrong:
        return
    for names in (list(looks), wrong):
        best = _best(names, looks, own, stored, workspace, table_z_m)
        if best is not None:
            tilts = [_tilt(looks[name], own[name]) for name in names]
            raise PlopError(
                "Poses of cameras are in another convention." if best[0].scale == 1 else "Depth is in another unit.",
                where=f"{episode}: camera {', '.join(names)}",
                expected="camera -> robot base, metres, extrinsic xyz Euler angles in radians, OpenCV axes (right, down, "
                "forward)" if best[0].scale == 1 else "millimetres",
                found=f"{best[0].name}: so read, the table is level at {best[1]:.3f} m; as stored, the largest plane is "
                f"tilted by {' and '.join(f'{tilt:.0f}' for tilt in tilts)} deg or lies elsewhere",
                fix="Convert the poses and run again." if best[0].scale == 1 else
                f"Multiply the depth pictures by {best[0].scale:g} and run again.",
                cause=Cause.EXTRINSICS if best[0].scale == 1 else Cause.DEPTH)  # fmt: skip


def _look(picture: Picture, count: int = 3000) -> _Look:
    """Take points and the three largest planes."""
    measured = picture.depth_m > 0
    points = (picture.camera.pixel_directions() * picture.depth_m[..., None])[measured].astype(np.float64)
    points = points[:: max(1, len(points) // count)]
    rest, planes = points, []
    for _ in range(3):
        if len(rest) < max(50, SMALLEST_PLANE * len(points)):
            break
        threshold = 0.01 * float(np.median(np.linalg.norm(rest, axis=1)))
        plane = find_plane(rest, threshold_m=threshold, trials=200)
        on = np.abs(plane.signed_distance(rest)) < threshold
        if on.sum() < SMALLEST_PLANE * len(points):
            break
        planes.append((plane, rest[on].mean(0)))
        rest = rest[~on]
    return _Look(points, planes)


def _fits(look: _Look, guess: _Guess, workspace: np.ndarray) -> Iterator[_Fit]:
    """Place each plane of a camera in the world."""
    world = transform_points(guess.pose, look.points * guess.scale)
    across = ((world[:, :2] >= workspace[0, :2]) & (world[:, :2] <= workspace[1, :2])).all(1)
    for plane, middle in look.planes:
        up = guess.pose[:3, :3] @ plane.normal * (-1 if plane.offset_m > 0 else 1)  # the camera is on its upper side
        at = transform_points(guess.pose, middle * guess.scale)
        height = float(at[2])
        above = across & (world[:, 2] > height - NEAR_M) & (world[:, 2] < max(workspace[1, 2], height + 0.3))
        yield _Fit(float(np.degrees(np.arccos(np.clip(up[2], -1, 1)))), height, float(above.mean()),
                   world[above & (world[:, 2] > height + NEAR_M)])  # fmt: skip


def _loose(look: _Look, guess: _Guess, workspace: np.ndarray, table_z_m: float | None) -> bool:
    low, high = (workspace[0, 2], workspace[1, 2]) if table_z_m is None else (table_z_m, table_z_m)
    return any(fit.tilt_deg < LOOSE_DEG and low - LOOSE_M <= fit.height_m <= high + LOOSE_M
               for fit in _fits(look, guess, workspace))  # fmt: skip


def _strict(look: _Look, guess: _Guess, workspace: np.ndarray, table_z_m: float | None) -> list[_Fit]:
    low, high = (workspace[0, 2], workspace[1, 2]) if table_z_m is None else (table_z_m, table_z_m)
    return [fit for fit in _fits(look, guess, workspace) if fit.tilt_deg < TILT_DEG and fit.in_workspace > IN_WORKSPACE
            and low - HEIGHT_M <= fit.height_m <= high + HEIGHT_M]  # fmt: skip


def _apart(
    looks: Mapping[str, _Look], own: Mapping[str, _Guess], workspace: np.ndarray, table_z_m: float | None
) -> list[str]:
    """Give all cameras where each has a level plane, but at heights that cannot be one table; else none."""
    heights = [[fit.height_m for fit in _fits(look, own[name], workspace) if fit.tilt_deg < LOOSE_DEG]
               for name, look in looks.items() if look.planes]  # fmt: skip
    if table_z_m is not None or len(heights) < 2:
        return []
    apart = min(max(abs(height - near) for near in (min(other, key=lambda z: abs(z - height)) for other in heights))
                for height in heights[0])  # fmt: skip
    return list(looks) if apart > LOOSE_M * 2 else []


def _best(
    names: list[str], looks: Mapping[str, _Look], own: Mapping[str, _Guess], stored: Mapping[str, np.ndarray],
    workspace: np.ndarray, table_z_m: float | None,
) -> tuple[_Guess, float] | None:  # fmt: skip
    """Give the guess, the same for all `names`, that puts them right beside the others, and the table's height."""
    found = []
    for guesses in zip_longest(*(_guesses(own[name], stored[name]) for name in names)):
        chosen = dict(own) | dict(zip(names, guesses, strict=True))
        fits = {name: _strict(look, chosen[name], workspace, table_z_m) for name, look in looks.items() if look.planes}
        if not fits or not all(fits.values()):
            continue
        best = [max(options, key=lambda fit: fit.in_workspace) for options in fits.values()]
        heights = [fit.height_m for fit in best]
        if np.ptp(heights) > APART_M:
            continue
        found.append((guesses[0].departures, -_agreement([fit.cloud for fit in best]), guesses[0], float(np.mean(heights))))
    if not found:
        return None
    found.sort(key=lambda item: (item[0], item[1]))
    return found[0][2], found[0][3]


def _guesses(own: _Guess, pose6: np.ndarray) -> Iterator[_Guess]:
    for scale, unit in DEPTH_UNITS.items():
        yield _Guess(f"depth in units of {unit}", own.pose, scale, 1)
    for reading in readings_of(pose6):
        if reading.departures:
            yield _Guess(" and ".join(reading.departures), reading.world_from_cam, 1.0, len(reading.departures))


def _agreement(clouds: list[np.ndarray]) -> float:
    """Share of points above the table that another camera sees, too; 0 for a single camera."""
    shares = [float((cKDTree(other).query(cloud)[0] < NEAR_M).mean()) for i, cloud in enumerate(clouds)
              for j, other in enumerate(clouds) if i != j and len(cloud) and len(other)]  # fmt: skip
    return float(np.mean(shares)) if shares else 0.0


def _tilt(look: _Look, guess: _Guess) -> float:
    (plane, _), *_ = look.planes or [(Plane(np.array([0, 0, 1.0]), 0.0, 0.0), np.zeros(3))]
    up = guess.pose[:3, :3] @ plane.normal
    return float(np.degrees(np.arccos(np.clip(abs(up[2]), 0, 1))))
