"""Bring DROID's clocks together: rows of the trajectory, frames of the videos, poses at capture time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz

CAPTURE_LATENCY_MS = 41
"""DROID's own estimate: a frame was captured so long before it was received [ms]."""


def frames_of_rows(
    received_ms: np.ndarray, frames: int, stamps_path: Path, video: Path
) -> tuple[np.ndarray, list[str]]:
    """Find the video frame of every trajectory row.

    The MP4 header (60 fps) is never used: either the side file of time stamps says it, or row i is frame i.

    Args:
        received_ms: `<serial>_frame_received` of every row, Unix ms, shape [T]; -1 unknown.
        frames: Frames that the video really has.
        stamps_path: `<serial>_timestamps.json`, which need not exist.
        video: The video, for messages.

    Returns:
        Frame numbers, shape [T], -1 where a row has no frame; warnings.

    Raises:
        PlopError: Rows and frames cannot be matched.
    """
    rows = len(received_ms)
    stamps, warnings = read_stamps(stamps_path)
    if stamps is not None and not (received_ms > 0).any():
        warnings.append(
            f"{stamps_path}: the trajectory has no frame_received for this camera; row i is taken as frame i"
        )
        stamps = None
    if stamps is None:
        if rows - frames not in (0, 1):
            raise PlopError("Rows and frames cannot be matched.", where=video,
                            expected=f"{rows} or {rows - 1} frames, because {stamps_path.name} is missing",
                            found=f"{frames} frames", fix="Bring the time stamps file.")  # fmt: skip
        index = np.arange(rows)
        return np.where(index < frames, index, -1), warnings
    if len(stamps) - frames not in (0, 1, -1):
        raise PlopError("The time stamps do not belong to this video.", where=stamps_path,
                        expected=f"{frames} entries, as {video.name} has frames", found=f"{len(stamps)} entries",
                        fix="Copy both files again.")  # fmt: skip
    where = {int(stamp): frame for frame, stamp in enumerate(stamps[:frames])}
    index = np.array([where.get(int(stamp), -1) for stamp in received_ms])
    missing = np.flatnonzero(index < 0)
    if len(missing) == rows:
        raise PlopError("No time stamp equals one of the trajectory.", where=stamps_path,
                        expected=f"values like {int(received_ms.max())} ms", found=f"{stamps[:3]}...",
                        fix="The file belongs to another episode.")  # fmt: skip
    if len(missing):
        shown = ", ".join(str(row) for row in missing[:8]) + (", ..." if len(missing) > 8 else "")
        warnings.append(f"{video}: no frame for {len(missing)} of {rows} rows ({shown}); these rows are left out")
    return index, warnings


def read_stamps(path: Path) -> tuple[np.ndarray | None, list[str]]:
    """Read `<serial>_timestamps.json`: Unix ms, one per frame; None when it is missing or of no use."""
    if not path.is_file():
        return None, [f"{path}: missing; row i is taken as frame i"]
    try:
        stamps = np.asarray(json.loads(path.read_text()), dtype=np.int64)
    except (OSError, ValueError, TypeError, OverflowError) as error:
        return None, [f"{path}: not readable ({error}); row i is taken as frame i"]
    if stamps.ndim != 1 or not len(stamps):
        return None, [f"{path}: not a list of numbers; row i is taken as frame i"]
    return stamps, []


def capture_times(captured_ms: np.ndarray, received_ms: np.ndarray, robot_ms: np.ndarray) -> np.ndarray:
    """Give the best known capture time of every row, Unix ms, shape [T], float64.

    estimated_capture, else frame_received - 41 ms, else the robot's clock; NaN where none is known.
    """
    best = np.where(robot_ms > 0, robot_ms, np.nan).astype(np.float64)
    best = np.where(received_ms > 0, received_ms - CAPTURE_LATENCY_MS, best)
    return np.where(captured_ms > 0, captured_ms, best)


def poses_at(poses6: np.ndarray, pose_ms: np.ndarray, wanted_ms: np.ndarray) -> np.ndarray:
    """Interpolate poses to the moments of the pictures: robot and camera are not read at the same instant.

    Args:
        poses6: [x, y, z, a, b, c] per row, shape [T, 6], metres and radians; NaN rows are passed over.
        pose_ms: When they were read, shape [T], Unix ms; -1 unknown.
        wanted_ms: Moments asked for, shape [N]; outside the known range the nearest pose is given.

    Returns:
        Poses, shape [N, 4, 4]; NaN where the moment is NaN.
    """
    good = np.isfinite(poses6).all(1) & (pose_ms > 0)
    times, first = np.unique(pose_ms[good].astype(np.float64), return_index=True)
    matrices = pose_from_euler_xyz(poses6[good][first])
    if len(times) < 2:
        return np.repeat(matrices[:1], len(wanted_ms), axis=0)
    wanted = np.clip(np.nan_to_num(wanted_ms, nan=times[0]), times[0], times[-1])
    out = np.repeat(np.eye(4)[None], len(wanted), axis=0)
    out[:, :3, :3] = Slerp(times - times[0], Rotation.from_matrix(matrices[:, :3, :3]))(wanted - times[0]).as_matrix()
    out[:, :3, 3] = np.stack([np.interp(wanted, times, matrices[:, axis, 3]) for axis in range(3)], axis=1)
    out[~np.isfinite(wanted_ms)] = np.nan
    return out


def active_rows(
    flange: np.ndarray, time_s: np.ndarray, rows: np.ndarray, *, idle_s: float, idle_m: float
) -> np.ndarray:
    """Leave out long stretches in which the robot stands still.

    Args:
        flange: Poses, shape [T, 6].
        time_s: Time of every row, shape [T].
        rows: Candidate rows, ascending, shape [N].
        idle_s: A longer stretch is cut down to this length [s]; 0 keeps everything.
        idle_m: Movement that counts as standing still [m].

    Returns:
        The rows to keep.
    """
    if idle_s <= 0 or not len(rows):
        return rows
    keep, anchor, since = [], flange[rows[0], :3], time_s[rows[0]]
    for row in rows:
        if np.linalg.norm(flange[row, :3] - anchor) > idle_m:
            anchor, since = flange[row, :3], time_s[row]
        if time_s[row] - since <= idle_s:
            keep.append(row)
    return np.asarray(keep, dtype=np.int64)
