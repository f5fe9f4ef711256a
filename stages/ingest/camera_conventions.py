"""Cameras whose pose cannot be right: find the convention, or the unit of depth, in which it would be.

The judge is the table. A camera that sees the workspace sees a horizontal plane at the table's height, from above; a
pose under which none of the largest planes of its depth is such a plane is wrong. A convention in which the same six
numbers put one there for every camera is named. It is never applied: the data must be corrected, for every program that
reads them. What keeps the table level and in place (a turn about the vertical) is not found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.spatial import cKDTree

from plop.causes import Cause
from plop.errors import PlopError
from plop.geometry.clouds.plane import Plane, find_plane
from plop.geometry.pose_conventions import readings_of
from plop.geometry.rigid import transform_points
from stages.ingest.masks import Picture

LOOSE_DEG, LOOSE_M = 12.0, 0.08
"""A camera whose plane is nearer to the table than this is not accused: real poses are 1 to 2 deg off, so 2 to 4 cm at
1 m, and `plop calibrate` is there for them."""
TILT_DEG, HEIGHT_M = 5.0, 0.05
"""A reading under which the plane is nearer than this puts the camera right: the same errors with a margin."""
APART_M = 0.07
"""How far apart the cameras' tables may then lie: sqrt(2) HEIGHT_M, as the errors are independent [m]."""
SMALLEST_PLANE = 0.08
"""A plane that holds a smaller share of a camera's points is not looked at."""
IN_WORKSPACE = 0.05
"""Smallest share of a camera's points in the workspace, on or above its table."""
TIE = 0.1
"""Guesses whose clouds agree as well, to this share of their points, cannot be told apart: all are named."""
NONE_IN_BOX = 0.01
"""Another unit of depth is thought of only where a smaller share of the points lies in the workspace."""
RANGE_M = (0.15, 4.0)
"""Median depth of a camera that sees a workspace [m]."""
NEAR_M = 0.02
"""Points of two cameras nearer than this are of one surface [m]."""
DEPTH_UNITS = {
    0.1: "0.1 mm (RealSense D405)",
    0.2: "0.2 mm (1/5000 m, TUM)",
    0.25: "0.25 mm (RealSense L515)",
    10.0: "cm",
    1000.0: "m",
    0.001: "um",
}
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
    pictures: Mapping[str, Picture],
    stored: Mapping[str, np.ndarray],
    workspace: np.ndarray,
    table_z_m: float | None,
    episode: str,
) -> None:
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
        likely = _best(names, looks, own, stored, workspace, table_z_m)
        if likely:
            raise _refusal(names, likely, [_as_stored(looks[name], own[name], workspace) for name in names], episode)


def _refusal(names: list[str], likely: list[tuple[_Guess, float]], as_stored: list[str], episode: str) -> PlopError:
    units = likely[0][0].scale != 1
    told = ", or ".join(f"{guess.name} (the table is then level at {height:.3f} m)" for guess, height in likely[:4])
    planes = f"as stored, the largest plane of each is {', '.join(as_stored)} (180 deg: seen from below)"
    if units:
        factors = " or ".join(f"{guess.scale:g}" for guess, _ in likely)
        which = "" if len(likely) == 1 else " (table_z in plop_episode.json would tell which)"
        return PlopError(
            "Depth is in another unit.",
            where=f"{episode}: camera {', '.join(names)}",
            expected="millimetres",
            found=told,
            cause=Cause.DEPTH,
            fix=f"Multiply the depth pictures by {factors} and run again{which}. (If they are in "
            "millimetres, workspace or table_z of plop_episode.json is wrong.)",
        )
    return PlopError(
        "Poses of cameras are in another convention.",
        where=f"{episode}: camera {', '.join(names)}",
        expected="camera -> robot base, metres, extrinsic xyz Euler angles in radians, OpenCV axes "
        "(right, down, forward)",
        found=f"probably {told}; {planes}",
        cause=Cause.EXTRINSICS,
        fix="Convert the poses to plop's convention and run again. (If they are in it, workspace or "
        "table_z of plop_episode.json is wrong.)",
    )


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
        yield _Fit(
            float(np.degrees(np.arccos(np.clip(up[2], -1, 1)))),
            height,
            float(above.mean()),
            world[above & (world[:, 2] > height + NEAR_M)],
        )


def _loose(look: _Look, guess: _Guess, workspace: np.ndarray, table_z_m: float | None) -> bool:
    low, high = (workspace[0, 2], workspace[1, 2]) if table_z_m is None else (table_z_m, table_z_m)
    return any(
        fit.tilt_deg < LOOSE_DEG and low - LOOSE_M <= fit.height_m <= high + LOOSE_M
        for fit in _fits(look, guess, workspace)
    )


def _strict(look: _Look, guess: _Guess, workspace: np.ndarray, table_z_m: float | None) -> list[_Fit]:
    low, high = (workspace[0, 2], workspace[1, 2]) if table_z_m is None else (table_z_m, table_z_m)
    return [
        fit
        for fit in _fits(look, guess, workspace)
        if fit.tilt_deg < TILT_DEG
        and fit.in_workspace > IN_WORKSPACE
        and low - HEIGHT_M <= fit.height_m <= high + HEIGHT_M
    ]


def _apart(
    looks: Mapping[str, _Look], own: Mapping[str, _Guess], workspace: np.ndarray, table_z_m: float | None
) -> list[str]:
    """Give all cameras where each has a level plane, but at heights that cannot be one table; else none."""
    heights = [
        [fit.height_m for fit in _fits(look, own[name], workspace) if fit.tilt_deg < LOOSE_DEG]
        for name, look in looks.items()
        if look.planes
    ]
    if table_z_m is not None or len(heights) < 2:
        return []
    apart = min(
        max(abs(height - near) for near in (min(other, key=lambda z: abs(z - height)) for other in heights))
        for height in heights[0]
    )
    return list(looks) if apart > LOOSE_M * 2 else []


def _best(
    names: list[str],
    looks: Mapping[str, _Look],
    own: Mapping[str, _Guess],
    stored: Mapping[str, np.ndarray],
    workspace: np.ndarray,
    table_z_m: float | None,
) -> list[tuple[_Guess, float]]:
    """Give the guesses that put all `names` right beside the others, with the table's height; the likeliest first.

    One guess is the same for all of `names`. Fewer departures are likelier, then clouds of cameras that agree.
    """
    found = []
    astray = all(_share_in_box(looks[name], own[name], workspace) < NONE_IN_BOX for name in names)
    medians_m = [float(np.median(looks[name].points[:, 2])) for name in names]
    for guesses in zip_longest(*(_guesses(own[name], stored[name], units=astray) for name in names)):
        scale = guesses[0].scale
        if scale != 1 and not all(RANGE_M[0] < scale * median_m < RANGE_M[1] for median_m in medians_m):
            continue
        chosen = dict(own) | dict(zip(names, guesses, strict=True))
        fits = {name: _strict(look, chosen[name], workspace, table_z_m) for name, look in looks.items() if look.planes}
        if not fits or not all(fits.values()):
            continue
        best = [max(options, key=lambda fit: fit.in_workspace) for options in fits.values()]
        heights = [fit.height_m for fit in best]
        if np.ptp(heights) <= APART_M:
            agreement = _agreement([fit.cloud for fit in best])
            found.append((guesses[0].departures, -agreement, guesses[0], float(np.mean(heights))))
    found.sort(key=lambda item: item[:2])
    likely = [item for item in found if item[0] == found[0][0] and item[1] <= found[0][1] + TIE]
    return [(guess, height) for _, _, guess, height in likely]


def _share_in_box(look: _Look, guess: _Guess, workspace: np.ndarray) -> float:
    world = transform_points(guess.pose, look.points)
    return float(((world >= workspace[0]) & (world <= workspace[1])).all(1).mean())


def _guesses(own: _Guess, pose6: np.ndarray, *, units: bool) -> Iterator[_Guess]:
    for scale, unit in DEPTH_UNITS.items() if units else ():
        yield _Guess(f"depth in units of {unit}", own.pose, scale, 1)
    for reading in readings_of(pose6):
        if reading.departures:
            yield _Guess(" and ".join(reading.departures), reading.world_from_cam, 1.0, len(reading.departures))


def _agreement(clouds: list[np.ndarray]) -> float:
    """Share of points above the table that another camera sees, too; 0 for a single camera."""
    shares = [
        float((cKDTree(other).query(cloud)[0] < NEAR_M).mean())
        for i, cloud in enumerate(clouds)
        for j, other in enumerate(clouds)
        if i != j and len(cloud) and len(other)
    ]
    return float(np.mean(shares)) if shares else 0.0


def _as_stored(look: _Look, guess: _Guess, workspace: np.ndarray) -> str:
    fit = next(_fits(look, guess, workspace), None)
    return f"tilted by {fit.tilt_deg:.0f} deg at {fit.height_m:.2f} m" if fit else "not found"
