"""Detection of wrong conventions of camera poses, and of wrong units of depth.

The criterion is the table. A camera that sees the workspace sees a horizontal plane at the table's height, from above;
a pose under which none of the largest planes of its depth is such a plane is wrong. A convention in which the same six
numbers give such a plane for every camera is reported. It is never applied: the data must be corrected, for every
program that reads them. Errors that keep the table level and at its height (a rotation about the vertical) are not
found.
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
"""Smallest reported distance of a camera's plane from the table: errors of real poses are 1 to 2 deg, so 2 to 4 cm at
1 m, and `plop calibrate` corrects them."""
TILT_DEG, HEIGHT_M = 5.0, 0.05
"""Largest distance of the plane under a correct convention: the same errors with a margin."""
APART_M = 0.07
"""Largest distance between the cameras' tables then: sqrt(2) HEIGHT_M, as the errors are independent [m]."""
SMALLEST_PLANE = 0.08
"""Smallest share of a camera's points on a plane."""
IN_WORKSPACE = 0.05
"""Smallest share of a camera's points in the workspace, on or above its table."""
TIE = 0.1
"""Guesses whose clouds agree equally well, to this share of their points, are indistinguishable: all are reported."""
NONE_IN_BOX = 0.01
"""Share of the points in the workspace below which another unit of depth is tested."""
RANGE_M = (0.15, 4.0)
"""Median depth of a camera that sees a workspace [m]."""
NEAR_M = 0.02
"""Points of two cameras closer than this are of one surface [m]."""
DEPTH_UNITS = {
    0.1: "0.1 mm (RealSense D405)",
    0.2: "0.2 mm (1/5000 m, TUM)",
    0.25: "0.25 mm (RealSense L515)",
    10.0: "cm",
    1000.0: "m",
    0.001: "um",
}
"""Millimetres per count -> the unit's name."""


@dataclass(frozen=True)
class _Look:
    """Measurement of a camera, in its own axes."""

    points: np.ndarray
    """Shape [N, 3] [m]."""
    planes: list[tuple[Plane, np.ndarray]]
    """The largest planes and the middle of each one's points [m]."""


@dataclass(frozen=True)
class _Guess:
    """One interpretation of the data of a camera."""

    name: str
    pose: np.ndarray
    scale: float = 1.0
    departures: int = 0


@dataclass(frozen=True)
class _Fit:
    """The table of a camera under a guess."""

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
    """Reject cameras that are correct under another convention, or another unit of depth.

    Args:
        pictures: First image of each camera.
        stored: Their poses as stored, [x, y, z, a, b, c] each.
        workspace: Lowest and highest corner, shape [2, 3] [m].
        table_z_m: Height of the table, if given by the user [m].
        episode: Name for the message.

    Raises:
        PlopError: Names the cameras and the correct convention. A camera without such a convention is accepted.
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
    likely_text = ", or ".join(
        f"{guess.name} (the table is then level at {height:.3f} m)" for guess, height in likely[:4]
    )
    planes = f"as stored, the largest plane of each is {', '.join(as_stored)} (180 deg: seen from below)"
    if units:
        factors = " or ".join(f"{guess.scale:g}" for guess, _ in likely)
        which = "" if len(likely) == 1 else " (set table_z in plop_episode.json to decide)"
        return PlopError(
            "The depth is in another unit.",
            where=f"{episode}: camera {', '.join(names)}",
            expected="millimetres",
            found=likely_text,
            cause=Cause.DEPTH,
            fix=f"Multiply the depth images by {factors} and run again{which}. (If they are in "
            "millimetres, workspace or table_z of plop_episode.json is wrong.)",
        )
    return PlopError(
        "Poses of cameras use another convention.",
        where=f"{episode}: camera {', '.join(names)}",
        expected="camera -> robot base, metres, extrinsic xyz Euler angles in radians, OpenCV axes "
        "(right, down, forward)",
        found=f"probably {likely_text}; {planes}",
        cause=Cause.EXTRINSICS,
        fix="Convert the poses to plop's convention and run again. (If they already use it, workspace or "
        "table_z of plop_episode.json is wrong.)",
    )


def _look(picture: Picture, count: int = 3000) -> _Look:
    """Extract points and the three largest planes."""
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
    """Transform each plane of a camera to the world."""
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
    """Return all cameras if each has a level plane, but at heights inconsistent with one table; else none."""
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
    """Return the guesses under which all `names` agree with the others, with the table's height; the likeliest first.

    One guess applies to all of `names`. Fewer departures are likelier, then clouds of cameras that agree.
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
    """Return the share of points above the table that another camera also sees; 0 for a single camera."""
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
