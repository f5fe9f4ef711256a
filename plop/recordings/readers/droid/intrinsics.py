"""Find a DROID camera's intrinsics: in the trajectory, in a side file, or from the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.recordings.readers.droid.layout import DroidFolder
from plop.recordings.readers.side_file import read_json

ZED_WIDTHS = {1280: 720, 1920: 1080, 2208: 1242, 672: 376, 640: 360}
"""Resolutions of the intrinsics of DROID's cameras, width -> height [px]."""


def find_intrinsics(
    episode: DroidFolder,
    serial: str,
    size: tuple[int, int],
    *,
    stored: dict[str, np.ndarray],
    side: dict[str, Any],
    side_name: str,
    focal_px: float,
) -> tuple[np.ndarray, list[str]]:
    """Return K of the left eye for pixel centres at half-integers.

    Args:
        episode: The episode.
        serial: The camera.
        size: Width and height of the video (one eye) [px].
        stored: `camera_intrinsics` of the trajectory.
        side: Content of intrinsics.json; {} when there is none.
        side_name: Its path, for messages.
        focal_px: Fallback, the focal length at 1280 px width; 0 = not given.

    Returns:
        K, shape [3, 3] [px]; warnings.

    Raises:
        PlopError: None of the three sources gives a plausible K.
    """
    width, height = size
    warnings: list[str] = []
    if f"{serial}_left" in stored:
        matrix = stored[f"{serial}_left"]
        where = f"{episode.trajectory}:/observation/camera_intrinsics/{serial}_left"
    elif (entry := _side_entry(episode, serial, side)) is not None:
        where = f"{side_name}: {serial}"
        matrix, warnings = matrix_from_side(entry, where)
    elif focal_px > 0:
        focal = focal_px * width / 1280
        warnings.append(
            f"{episode.name}: camera {serial} has no intrinsics; "
            f"fx = {focal:.0f} px and the image centre are assumed: run `plop calibrate`"
        )
        return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]]), warnings
    else:
        raise PlopError(
            "A camera has no intrinsics.",
            where=f"{episode.folder}: camera {serial}",
            expected="observation/camera_intrinsics in trajectory.h5, or intrinsics.json in the raw folder",
            found="neither: the raw release has them in the SVO files only",
            fix="Add intrinsics.json, or set cameras.exterior_focal_px / cameras.wrist_focal_px "
            "(HD720: about 530 for a ZED 2, 733 for a ZED Mini).",
        )
    matrix, more = _fit_to_size(matrix, width, height, where)
    matrix[:2, 2] += 0.5  # OpenCV and ZED put pixel centres at integers, plop at half-integers
    return matrix, [*warnings, *more]


def matrix_from_side(entry: Any, where: str) -> tuple[np.ndarray, list[str]]:
    """Read one entry of intrinsics.json: {"cameraMatrix": ...} or the bare value.

    Four numbers are [fx, cx, fy, cy] in DROID's files. [fx, fy, cx, cy] is recognised by its numbers
    (fx and fy of a camera agree within 5 %), because both orders exist.

    Raises:
        PlopError: The numbers match neither order.
    """
    value = entry.get("cameraMatrix") if isinstance(entry, dict) else entry
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.size == 9:
        return numbers.reshape(3, 3).copy(), []
    if numbers.shape == (4,) and np.isfinite(numbers).all() and (numbers > 0).all():
        a, b, c, d = numbers
        if abs(a - c) <= 0.05 * a:
            return np.array([[a, 0, b], [0, c, d], [0, 0, 1.0]]), []
        if abs(a - b) <= 0.05 * a:
            return np.array([[a, 0, c], [0, b, d], [0, 0, 1.0]]), [f"{where}: read as [fx, fy, cx, cy]"]
    raise PlopError(
        "The intrinsics cannot be read.",
        where=where,
        expected="[fx, cx, fy, cy] in px, or a 3x3 matrix",
        found=str(value)[:120],
        fix="Correct the file.",
    )


def load_side_file(path: Path | None, what: str) -> dict[str, Any]:
    """Read a JSON side file (intrinsics.json, cam2base_extrinsics.json); {} when there is none.

    Raises:
        PlopError: The file is not a JSON object.
    """
    if path is None or not path.is_file():
        return {}
    try:
        content = read_json(path)
    except (OSError, ValueError) as error:
        raise PlopError(
            f"The file of {what} cannot be read.",
            where=path,
            expected="JSON, keyed by uuid",
            found=str(error),
            fix="Copy the file again.",
        ) from error
    if not isinstance(content, dict):
        raise PlopError(
            f"The file of {what} is not keyed by uuid.",
            where=path,
            expected="a JSON object",
            found=type(content).__name__,
            fix="Correct the file.",
        )
    return content


def side_of_episode(episode: DroidFolder, side: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a side file that concerns one episode; one keyed by serial number applies to all."""
    for uuid, entry in side.items():
        if episode.matches_uuid(uuid) and isinstance(entry, dict):
            return entry
    return side if not any("+" in key for key in side) else {}  # a DROID uuid is <lab>+<user>+<time>


def _side_entry(episode: DroidFolder, serial: str, side: dict[str, Any]) -> Any | None:
    entry = side_of_episode(episode, side)
    return entry.get(serial, entry.get(f"{serial}_left"))


def _fit_to_size(matrix: np.ndarray, width: int, height: int, where: str) -> tuple[np.ndarray, list[str]]:
    """Accept K when its principal point is near the image centre; rescale it when it was written for another size."""
    matrix = np.array(matrix, dtype=np.float64)
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    if not np.isfinite(matrix).all() or fx <= 0 or fy <= 0 or abs(fx - fy) > 0.1 * fx:
        raise PlopError(
            "The intrinsics are not plausible.",
            where=where,
            expected="positive and about equal fx and fy",
            found=f"fx={fx:.1f}, fy={fy:.1f}, cx={cx:.1f}, cy={cy:.1f}",
            fix="Correct them.",
        )
    if _near_middle(cx, cy, width, height):
        return matrix, []
    for known_width, known_height in ZED_WIDTHS.items():
        same_aspect = abs(known_width / known_height - width / height) < 0.02
        if same_aspect and _near_middle(cx, cy, known_width, known_height):
            matrix[:2] *= width / known_width
            return matrix, [f"{where}: written for {known_width} px width, scaled to {width}"]
    raise PlopError(
        "The intrinsics belong to another image size.",
        where=where,
        expected=f"a principal point near ({width / 2:.0f}, {height / 2:.0f})",
        found=f"({cx:.0f}, {cy:.0f})",
        fix="Add intrinsics for the size of this video.",
    )


def _near_middle(cx: float, cy: float, width: int, height: int) -> bool:
    return abs(cx - width / 2) < 0.15 * width and abs(cy - height / 2) < 0.15 * height
