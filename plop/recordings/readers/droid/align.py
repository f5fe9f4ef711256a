"""Synchronise DROID's clocks: rows of the trajectory, frames of the videos, poses at capture time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.clock import TimeUnit, read_clock
from plop.recordings.readers.side_file import read_json

FASTEST_M_S = 5.0
"""Upper bound of an arm's mean speed over a recording (the fastest joints reach about 4 m/s briefly) [m/s]."""
CAPTURE_LATENCY_MS = 41
"""DROID's own estimate of the delay between capture and reception of a frame [ms]."""


def frames_of_rows(
    received_ms: np.ndarray, frames: int, stamps_path: Path, origin_ns: int, video: Path
) -> tuple[np.ndarray, list[str]]:
    """Find the video frame of every trajectory row.

    The MP4 header (60 fps) is never used: frames follow from the side file of time stamps, or row i is frame i.

    Args:
        received_ms: `<serial>_frame_received` of every row, shape [T] [ms since `origin_ns`]; NaN unknown.
        frames: Actual number of frames of the video.
        stamps_path: `<serial>_timestamps.json`, which need not exist.
        origin_ns: The trajectory's time origin.
        video: The video, for messages.

    Returns:
        Frame numbers, shape [T], -1 where a row has no frame; warnings.

    Raises:
        PlopError: Rows and frames cannot be matched.
    """
    rows = len(received_ms)
    stamps, warnings = read_stamps(stamps_path, origin_ns)
    if stamps is not None and not np.isfinite(received_ms).any():
        warnings.append(
            f"{stamps_path}: the trajectory has no frame_received for this camera; row i is taken as frame i"
        )
        stamps = None
    if stamps is None:
        if rows - frames not in (0, 1):
            raise PlopError(
                "Rows and frames cannot be matched.",
                where=video,
                expected=f"{rows} or {rows - 1} frames, because {stamps_path.name} is missing",
                found=f"{frames} frames",
                fix="Add the time stamps file.",
            )
        index = np.arange(rows)
        return np.where(index < frames, index, -1), warnings
    if len(stamps) - frames not in (0, 1, -1):
        raise PlopError(
            "The time stamps do not match this video.",
            where=stamps_path,
            expected=f"{frames} entries, one per frame of {video.name}",
            found=f"{len(stamps)} entries",
            fix="Copy both files again.",
        )
    index = _nearest(stamps[:frames], received_ms)
    missing = np.flatnonzero(index < 0)
    if len(missing) == rows:
        spans = [
            f"{_seconds(known.min())} to {_seconds(known.max())}"
            for column in (received_ms, stamps)
            if len(known := column[np.isfinite(column)])
        ]
        raise PlopError(
            "No time stamp matches one of the trajectory.",
            where=stamps_path,
            expected=f"stamps of the frames received {spans[0]}",
            found=f"{spans[1]} (seconds since the trajectory's first row)",
            fix="The file belongs to another episode, or has another time origin.",
        )
    if len(missing):
        shown = ", ".join(str(row) for row in missing[:8]) + (", ..." if len(missing) > 8 else "")
        warnings.append(f"{video}: no frame for {len(missing)} of {rows} rows ({shown}); these rows are left out")
    return index, warnings


def _nearest(stamps: np.ndarray, received_ms: np.ndarray) -> np.ndarray:
    """Return the frame whose stamp matches that of the row, shape [T]; -1 none.

    Both may be in different units, and rounded: DROID's own are whole ms, so they may differ by less than 1 ms, and
    never by half the step between frames.
    """
    known = np.flatnonzero(np.isfinite(stamps))
    order = known[np.argsort(stamps[known], kind="stable")]
    steps = np.diff(stamps[order])
    allowed = min(1.0, float(np.median(steps)) / 2) if len(steps) and np.median(steps) > 0 else 1.0
    wanted = np.nan_to_num(received_ms, nan=-np.inf)
    after = np.searchsorted(stamps[order], wanted)
    sides = np.stack([np.clip(after - 1, 0, len(order) - 1), np.clip(after, 0, len(order) - 1)])
    distance = np.abs(stamps[order][sides] - wanted)
    best = np.take_along_axis(sides, distance.argmin(0)[None], 0)[0]
    return np.where(distance.min(0) < allowed, order[best], -1)


def _seconds(ms: float) -> str:
    return f"{ms / 1000:.3f} s"


def read_stamps(path: Path, origin_ns: int) -> tuple[np.ndarray | None, list[str]]:
    """Read `<serial>_timestamps.json`: one stamp per frame, ms or another unit.

    Returns:
        Stamps [ms since `origin_ns`], NaN unknown; None where the file is missing or unusable. Warnings.
    """
    if not path.is_file():
        return None, [f"{path}: missing; row i is taken as frame i"]
    try:
        content = read_json(path)
        clock = (
            read_clock(content, documented=TimeUnit.MILLISECONDS, where=str(path))
            if isinstance(content, list)
            else None
        )
    except PlopError as error:
        return None, [f"{path}: {error.problem} (found: {error.found}); row i is taken as frame i"]
    except (OSError, ValueError) as error:
        return None, [f"{path}: not readable ({error}); row i is taken as frame i"]
    if clock is None:
        return None, [f"{path}: not a list of numbers; row i is taken as frame i"]
    foreign = [] if clock.unit is TimeUnit.MILLISECONDS else [f"{path}: read in {clock.unit.plural} (not milliseconds)"]
    return 1000 * clock.since(origin_ns), foreign + list(clock.notes)


def capture_times(captured_ms: np.ndarray, received_ms: np.ndarray, robot_ms: np.ndarray) -> np.ndarray:
    """Return the best known capture time of every row, shape [T] [ms]; NaN where none is known.

    estimated_capture, else frame_received - 41 ms, else the robot's clock.
    """
    best = np.where(np.isfinite(received_ms), received_ms - CAPTURE_LATENCY_MS, robot_ms)
    return np.where(np.isfinite(captured_ms), captured_ms, best)


def check_overlap(robot_ms: np.ndarray, time_ms: np.ndarray, where: str) -> None:
    """Reject images all taken before or after the robot's poses: every image would get the same pose.

    Args:
        robot_ms: Times of the poses, shape [T]; NaN unknown.
        time_ms: Times of the images, shape [T]; NaN unknown.
        where: The trajectory, for the message.

    Raises:
        PlopError: The two spans do not overlap.
    """
    robot, taken = robot_ms[np.isfinite(robot_ms)], time_ms[np.isfinite(time_ms)]
    if len(robot) < 2 or len(taken) < 2 or (taken.max() > robot.min() and taken.min() < robot.max()):
        return
    lag = float(np.median(taken) - np.median(robot)) / 1000
    raise PlopError(
        "The clocks of cameras and robot do not overlap.",
        where=where,
        expected=f"images within the {np.ptp(robot) / 1000:.3g} s of the robot's poses",
        found=f"images {abs(lag):.6g} s {'after' if lag > 0 else 'before'} them",
        fix="Write all stamps from one clock (an offset of whole hours is a time zone).",
    )


def check_speed(flange: np.ndarray, time_ms: np.ndarray, where: str) -> None:
    """Reject a clock under which the robot moves faster than any arm: this separates 1 Hz in s from 1 kHz in ms.

    Args:
        flange: Poses of the kept rows, shape [N, 6] [m].
        time_ms: Their times, shape [N] [ms].
        where: The trajectory, for the message.

    Raises:
        PlopError: The mean speed is beyond FASTEST_M_S.
    """
    path = float(np.linalg.norm(np.diff(flange[:, :3], axis=0), axis=1).sum())
    speed = path / max((time_ms[-1] - time_ms[0]) / 1000, 1e-9)
    if speed > FASTEST_M_S:
        raise PlopError(
            "The robot's speed according to the clock is not plausible.",
            where=where,
            expected=f"a mean speed of the flange below {FASTEST_M_S:g} m/s",
            found=f"{path:.2f} m in {(time_ms[-1] - time_ms[0]) / 1000:.4g} s, {speed:.3g} m/s",
            fix=f"Write the stamps in milliseconds: if they are seconds, the robot moves at {speed / 1000:.2g} m/s.",
        )


def poses_at(poses6: np.ndarray, pose_ms: np.ndarray, wanted_ms: np.ndarray) -> np.ndarray:
    """Interpolate poses to the times of the images: robot and camera are not read at the same instant.

    Args:
        poses6: [x, y, z, a, b, c] per row, shape [T, 6], metres and radians; NaN rows are skipped.
        pose_ms: Times of the poses, shape [T] [ms]; NaN unknown.
        wanted_ms: Times of the result, shape [N]; outside the known range the nearest pose is returned.

    Returns:
        Poses, shape [N, 4, 4]; NaN where the time is NaN.
    """
    good = np.isfinite(poses6).all(1) & np.isfinite(pose_ms)
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
    """Shorten long intervals in which the robot does not move.

    Args:
        flange: Poses, shape [T, 6].
        time_s: Time of every row, shape [T].
        rows: Candidate rows, ascending, shape [N].
        idle_s: A longer interval is cut to this length [s]; 0 keeps everything.
        idle_m: Largest movement that counts as no motion [m].

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
