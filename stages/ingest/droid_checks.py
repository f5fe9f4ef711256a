"""Checks of a DROID episode before it is written: valid images, visible object, consistent poses."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from plop.causes import Cause, Noticed
from plop.errors import PlopError
from plop.geometry.clouds.plane import Plane, find_plane
from plop.geometry.rigid import transform_points
from plop.geometry.view import MaskLabel
from stages.ingest.depth_points import estimate_table_z, world_points
from stages.ingest.masks import Picture

TABLE_TOLERANCE_M = 0.02
VIEWS_TOLERANCE_M = 0.02
SHARED_LEAST = 0.15
"""Smallest share of a camera's points on the largest flat surface of another camera: cameras that see one object also
see its support; planes that only intersect share a strip as wide as the tolerance. Of 120 simulated correct pairs
(tables of 0.7 to 6 m, a wall or none, depth noise up to 15 mm at 1 m) none is below 0.2 and 3 are below 0.3; of 20 with
a camera rotated by 30 deg and moved by 100 mm 18 are below 0.15."""
CAMERAS_FIX = (
    "Check the cameras' extrinsics: camera -> robot base, metres, extrinsic xyz Euler angles in radians, "
    "camera axes right, down, forward."
)
"""What to do about cameras that contradict each other or the table."""
MOVED_M, MOVED_DEG, MOVED_WITHIN_S = 0.01, 1.0, 600.0


def sees_nothing(picture: Picture) -> str:
    """Return why an image is unusable, "" when it is usable."""
    if float(picture.rgb.std()) < 1.5:
        return f"the image has a single colour (mean {picture.rgb.mean():.0f} of 255)"
    if not (picture.depth_m > 0).any():
        return "no pixel has depth"
    return ""


def object_cloud(pictures: Mapping[str, Picture], masks: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """World points of the object per camera, shape [N, 3] each [m]."""
    clouds = {}
    for serial, picture in pictures.items():
        use = (masks[serial] == MaskLabel.OBJECT) & (picture.depth_m > 0)
        clouds[serial] = world_points(picture.camera, picture.depth_m)[use]
    return clouds


def check_object(
    pictures: Mapping[str, Picture], clouds: Mapping[str, np.ndarray], workspace: np.ndarray, episode: str
) -> list[str]:
    """Check that at least one camera sees the object in the first frame.

    Raises:
        PlopError: No camera does; the message gives the positions of the measured points.
    """
    blind = [serial for serial, cloud in clouds.items() if not len(cloud)]
    if len(blind) < len(clouds):
        return [
            f"{episode}: camera {serial} does not see the object in the first frame (empty mask)" for serial in blind
        ]
    points = np.concatenate([world_points(p.camera, p.depth_m)[p.depth_m > 0] for p in pictures.values()])
    inside = ((points >= workspace[0]) & (points <= workspace[1])).all(1)
    low, middle, high = np.percentile(points, [10, 50, 90], axis=0).round(3).tolist()
    box = f"workspace {workspace[0].round(3).tolist()} .. {workspace[1].round(3).tolist()} m"
    if not inside.any():
        raise PlopError(
            "The object is outside the workspace: no measured point lies in it.",
            where=episode,
            expected=box,
            found=f"points around {middle} (most within {low} .. {high}) m",
            fix="Set workspace and table_z in plop_episode.json (metres, robot base); "
            "points ten or a thousand times too far indicate wrong units or extrinsics.",
            cause=Cause.MASKS,
        )
    raise PlopError(
        "The object's masks are empty in the first frame.",
        where=episode,
        expected=f"an object above the table in the {box}",
        found=f"{int(inside.sum())} points in the box, all of table, tool or hand",
        fix="Check table_z and workspace in plop_episode.json, or use --masks.",
        cause=Cause.MASKS,
    )


def check_views(
    pictures: Mapping[str, Picture],
    clouds: Mapping[str, np.ndarray],
    workspace: np.ndarray,
    table_z_m: float,
    episode: str,
) -> list[str]:
    """Warn about cameras whose table or object is inconsistent with the others: a sign of wrong extrinsics."""
    warnings = _torn_planes(pictures, episode)
    for serial, picture in pictures.items():
        points = world_points(picture.camera, picture.depth_m)[picture.depth_m > 0]
        height = estimate_table_z(points, workspace)
        if height is not None and abs(height - table_z_m) > TABLE_TOLERANCE_M:
            text = (
                f"{episode}: camera {serial} sees the table {1000 * (height - table_z_m):+.0f} mm from "
                f"table_z = {table_z_m:.3f} m: extrinsics or table_z are wrong (plop calibrate)"
            )
            warnings.append(Noticed(text, Cause.EXTRINSICS, CAMERAS_FIX))
    names = [serial for serial, cloud in clouds.items() if len(cloud) > 20]
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            near = [
                float(np.percentile(cKDTree(clouds[a]).query(clouds[b])[0], 25))
                for a, b in ((first, second), (second, first))
            ]
            if min(near) > VIEWS_TOLERANCE_M:
                text = (
                    f"{episode}: cameras {first} and {second} see the object {1000 * min(near):.0f} mm "
                    "apart: the extrinsics of one are wrong; run `plop calibrate`"
                )
                warnings.append(Noticed(text, Cause.EXTRINSICS, CAMERAS_FIX))
    return warnings


def _torn_planes(pictures: Mapping[str, Picture], episode: str) -> list[str]:
    """Warn about pairs of cameras neither of which has points on the largest flat surface of the other."""
    clouds = {serial: world_points(p.camera, p.depth_m)[p.depth_m > 0] for serial, p in pictures.items()}
    planes = {
        serial: find_plane(cloud, threshold_m=TABLE_TOLERANCE_M / 2)
        for serial, cloud in clouds.items()
        if len(cloud) >= 50
    }
    warnings: list[str] = []
    for first, second in combinations(planes, 2):
        shares = [
            float((np.abs(planes[a].signed_distance(clouds[b])) < TABLE_TOLERANCE_M).mean())
            for a, b in ((first, second), (second, first))
        ]
        if max(shares) < SHARED_LEAST:
            text = (
                f"{episode}: cameras {first} and {second} contradict each other: the largest flat surface (table) "
                f"of one lies {_between(planes[first], planes[second], clouds[second])} from the other's: "
                "the extrinsics of one or both are wrong"
            )
            warnings.append(Noticed(text, Cause.EXTRINSICS, CAMERAS_FIX))
    return warnings


def _between(one: Plane, other: Plane, points: np.ndarray) -> str:
    """Describe distance and angle between two planes at the points of the second."""
    angle = np.degrees(np.arccos(min(1.0, abs(float(one.normal @ other.normal)))))
    return f"{1000 * float(np.median(np.abs(one.signed_distance(points)))):.0f} mm and {angle:.0f} deg"


def closest_touch_m(
    tool_points: np.ndarray, world_from_tool: np.ndarray, object_points: np.ndarray
) -> tuple[float, int]:
    """Return the smallest distance of the tool from the object's initial position [m], and the frame.

    Args:
        tool_points: Points on the tool, shape [N, 3], tool frame [m].
        world_from_tool: Shape [T, 4, 4].
        object_points: Shape [M, 3] [m].
    """
    tree = cKDTree(object_points)
    gaps = [float(tree.query(transform_points(pose, tool_points))[0].min()) for pose in world_from_tool]
    return min(gaps), int(np.argmin(gaps))


def moved_cameras(reports: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Warn where a camera's pose differs between episodes minutes apart: it was moved, or one pose is wrong.

    Args:
        reports: Per episode {"stamp": "2023-08-06-22h-13m-04s", "lab", "poses": {serial: 4x4 nested list}}.
    """
    known: dict[tuple[str, str], list[tuple[datetime, str, np.ndarray]]] = {}
    for name, report in reports.items():
        if report.get("stamp"):
            moment = datetime.strptime(report["stamp"], "%Y-%m-%d-%Hh-%Mm-%Ss")
            for serial, pose in sorted(report.get("poses", {}).items()):
                known.setdefault((report.get("lab", ""), serial), []).append((moment, name, np.asarray(pose)))
    warnings = []
    for (_, serial), seen in known.items():
        seen.sort(key=lambda item: item[:2])
        for (at, name, pose), (later, other, moved) in zip(seen, seen[1:], strict=False):
            apart_s = (later - at).total_seconds()
            shift = float(np.linalg.norm(moved[:3, 3] - pose[:3, 3]))
            turn = float(np.degrees(Rotation.from_matrix(pose[:3, :3].T @ moved[:3, :3]).magnitude()))
            if apart_s <= MOVED_WITHIN_S and (shift > MOVED_M or turn > MOVED_DEG):
                warnings.append(
                    f"camera {serial} moves by {1000 * shift:.0f} mm and {turn:.1f} deg between {name} and "
                    f"{other}, {apart_s:.0f} s apart: it was moved, or one pose is wrong; "
                    "run `plop calibrate`"
                )
    return warnings
