"""One DROID raw episode: selected rows, synchronised cameras, poses of the tool."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError, remembering
from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.droid.align import active_rows, check_overlap, check_speed, poses_at
from plop.recordings.readers.droid.camera import DroidCamera, open_camera
from plop.recordings.readers.droid.camera_settings import DroidOptions
from plop.recordings.readers.droid.layout import DroidFolder, find_episodes
from plop.recordings.readers.droid.notes import EpisodeNotes, read_notes
from plop.recordings.readers.droid.tool import tool_mesh
from plop.recordings.readers.droid.trajectory import DroidTrajectory, read_trajectory
from plop.recordings.recording import Mesh
from plop.setting_kinds import Range, Settings, Unit

LONGEST_GAP_S = 0.5


@dataclass(frozen=True)
class RowChoice(Settings):
    """Which rows of a trajectory to keep; the defaults are defined only here."""

    keep_skipped: bool = False
    """Keep rows with skip_action."""
    idle_s: Annotated[float, Range(0, 1e6), Unit("s")] = 1.0
    """Intervals in which the robot does not move are cut to this length; 0 = kept."""
    idle_m: Annotated[float, Range(0, 1), Unit("m")] = 0.002
    """Largest movement of the flange that counts as no motion."""
    stride: Annotated[int, Range(1, 1e4)] = 1
    """Keep every n-th row."""
    min_frames: Annotated[int, Range(2, 1e6), Unit("frames")] = 5
    """Smallest number of frames; episodes with fewer are skipped."""
    scan_frames: Annotated[int, Range(1, 1e4), Unit("frames")] = 40
    """Largest number of frames of the wrist camera's scan."""


@dataclass(frozen=True)
class DroidScan:
    """Scan of the wrist camera before the interaction."""

    episode: str
    """Name of the episode that it is part of."""
    camera: DroidCamera
    rows: np.ndarray
    world_from_tool: np.ndarray
    """Tool at each scan frame, shape [S, 4, 4]."""


@dataclass(frozen=True)
class DroidEpisode:
    """A usable episode."""

    folder: DroidFolder
    trajectory: DroidTrajectory
    notes: EpisodeNotes
    cameras: list[DroidCamera]
    """Exterior cameras."""
    rows: np.ndarray
    """Rows of the trajectory, one per frame of the recording, shape [N]."""
    time_s: np.ndarray
    """Capture time since the first frame, shape [N] [s]."""
    world_from_flange: np.ndarray
    """Shape [N, 4, 4]."""
    world_from_tool: np.ndarray
    """Shape [N, 4, 4]."""
    tool: Mesh
    scan: DroidScan | None
    warnings: list[str] = field(default_factory=list)


def open_episode(folder: DroidFolder, options: DroidOptions, choice: RowChoice) -> DroidEpisode:
    """Read everything except the images.

    Raises:
        PlopError: The episode cannot be used; the message names file, key and frame, and it has the warnings
            collected before.
    """
    warnings = list(folder.warnings)
    with remembering(warnings):
        return _opened(folder, options, choice, warnings)


def _opened(folder: DroidFolder, options: DroidOptions, choice: RowChoice, warnings: list[str]) -> DroidEpisode:
    if not folder.recordings.is_dir():
        raise PlopError(
            "The episode has no recordings.",
            where=folder.recordings,
            expected="a folder with MP4/",
            found="nothing",
            fix="Copy it again, or leave the episode out.",
        )
    if (folder.recordings / "Depth").is_dir() and any((folder.recordings / "Depth").glob("*.png")):
        warnings.append(f"{folder.recordings / 'Depth'}: DROID's own depth export overflows 16 bits; ignored")
    trajectory = read_trajectory(folder.trajectory, serials=_metadata_serials(folder))
    notes = read_notes(folder)
    warnings += trajectory.warnings
    exterior, wrist = _open_cameras(folder, trajectory, options, warnings)
    rows, time_ms = _choose_rows(trajectory, notes, exterior, choice, warnings)
    flange = poses_at(trajectory.flange, trajectory.robot_time_ms, time_ms)
    flange_from_tool = pose_from_euler_xyz(notes.flange_from_tool)
    mesh, more = tool_mesh(notes.tool_mesh, folder.name)
    warnings += more
    scan = _open_scan(folder, trajectory, notes, wrist, options, choice, flange_from_tool, warnings)
    return DroidEpisode(
        folder,
        trajectory,
        notes,
        exterior,
        rows,
        (time_ms - time_ms[0]) / 1000,
        flange,
        flange @ flange_from_tool,
        mesh,
        scan,
        warnings,
    )


def _open_cameras(
    folder: DroidFolder, trajectory: DroidTrajectory, options: DroidOptions, warnings: list[str]
) -> tuple[list[DroidCamera], DroidCamera | None]:
    exterior: list[DroidCamera] = []
    wrist, refused = None, list[PlopError]()
    for serial in sorted(trajectory.camera_type):
        try:
            camera, more = open_camera(folder, trajectory, serial, options)
        except PlopError as error:
            refused.append(error)
            text = f"camera {serial} is left out: {error.problem} ({error.where}; found: {error.found})"
            warnings += [*error.noticed, Noticed(text, error.cause, error.fix or "")]
            continue
        warnings += more
        if camera.wrist:
            wrist = camera
        else:
            exterior.append(camera)
    if not exterior:
        reasons = [f"{error.problem} {error.where}: {error.found}" for error in refused]
        raise PlopError(
            "No fixed camera of the episode is usable.",
            where=folder.folder,
            expected="at least one exterior camera",
            found="; ".join(reasons) or "none in camera_type",
            fix=next((error.fix for error in refused if error.fix), "Leave the episode out."),
            cause=next((error.cause for error in refused), None),
        )
    return exterior, wrist


def _choose_rows(
    trajectory: DroidTrajectory, notes: EpisodeNotes, cameras: list[DroidCamera], choice: RowChoice, warnings: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of the recording and their capture time in ms."""
    first, last = _span(notes.interaction, trajectory.rows, f"{notes.path}: interaction", warnings)
    known = np.stack([camera.capture_ms for camera in cameras])
    counts = np.isfinite(known).sum(0)
    time_ms = np.where(counts > 0, np.nansum(known, axis=0) / np.maximum(counts, 1), np.nan)
    check_overlap(trajectory.robot_time_ms, time_ms, str(trajectory.path))
    _check_lag(trajectory, time_ms, warnings)
    has_frame = np.all([camera.frame_of_row >= 0 for camera in cameras], axis=0)
    good = has_frame & np.isfinite(trajectory.flange).all(1) & np.isfinite(time_ms)
    good &= choice.keep_skipped | ~trajectory.skipped
    good[:first] = good[last + 1 :] = False
    rows = np.flatnonzero(good)
    rows = rows[_increasing(time_ms[rows])]
    rows = active_rows(trajectory.flange, time_ms / 1000, rows, idle_s=choice.idle_s, idle_m=choice.idle_m)
    dropped = last + 1 - first - len(rows)
    rows = rows[:: choice.stride]
    if len(rows) < choice.min_frames:
        raise PlopError(
            "The episode has too few frames.",
            where=f"{trajectory.path}: rows {first}..{last}",
            expected=f"{choice.min_frames} or more",
            found=f"{len(rows)} ({int(trajectory.skipped[first : last + 1].sum())} rows have skip_action, "
            f"{int((~has_frame[first : last + 1]).sum())} have no frame)",
            fix="Leave the episode out, or set rows.keep_skipped / rows.idle_s / rows.min_frames.",
        )
    check_speed(trajectory.flange[rows], time_ms[rows], str(trajectory.path))
    if dropped:
        warnings.append(
            f"{trajectory.path}: {dropped} of {last + 1 - first} rows left out "
            "(skip_action, no motion, no frame or no pose)"
        )
    gaps = np.diff(time_ms[rows]) / 1000
    if gaps.max() > LONGEST_GAP_S * choice.stride:
        at = int(np.argmax(gaps))
        warnings.append(f"{trajectory.path}: {gaps[at]:.2f} s between rows {rows[at]} and {rows[at + 1]}")
    return rows, time_ms[rows]


def _check_lag(trajectory: DroidTrajectory, time_ms: np.ndarray, warnings: list[str]) -> None:
    known = np.isfinite(time_ms) & np.isfinite(trajectory.robot_time_ms)
    lag = np.median(time_ms[known] - trajectory.robot_time_ms[known]) if known.any() else 0.0
    if abs(lag) > 250:
        warnings.append(
            Noticed(
                f"{trajectory.path}: images are {lag:.0f} ms off the robot's clock (median); "
                "poses are interpolated, but check the clocks",
                Cause.CLOCK,
                "Check that the time stamps of robot and cameras come from one clock and are in milliseconds.",
            )
        )


def _span(span: tuple[int, int] | None, rows: int, where: str, warnings: list[str]) -> tuple[int, int]:
    if span is None:
        return 0, rows - 1
    if span[0] >= rows:
        raise PlopError(
            "The rows exceed the end of the episode.",
            where=where,
            expected=f"rows below {rows}",
            found=str(list(span)),
            fix="Correct plop_episode.json.",
        )
    if span[1] >= rows:
        warnings.append(f"{where}: {list(span)}, but the episode has {rows} rows; cut to {rows - 1}")
    return span[0], min(span[1], rows - 1)


def _increasing(time_ms: np.ndarray) -> np.ndarray:
    """Mark entries that are later than all before them."""
    before = np.concatenate([[-np.inf], np.maximum.accumulate(time_ms)[:-1]]) if len(time_ms) else time_ms
    return time_ms > before


def _open_scan(
    folder: DroidFolder,
    trajectory: DroidTrajectory,
    notes: EpisodeNotes,
    wrist: DroidCamera | None,
    options: DroidOptions,
    choice: RowChoice,
    flange_from_tool: np.ndarray,
    warnings: list[str],
) -> DroidScan | None:
    """Open the scan; a scan that cannot be read causes a warning, not an error."""
    span, where, name = notes.scan, f"{notes.path}: scan", folder.name
    try:
        if notes.scan_episode is not None:
            where = f"{notes.path}: scan_episode"
            other = find_episodes(notes.scan_episode)[0]
            name = other.name
            trajectory = read_trajectory(other.trajectory, serials=_metadata_serials(other))
            wrist = _open_cameras_wrist(other, trajectory, options, warnings)
            span = span or (0, trajectory.rows - 1)
        if span is None:
            return None
        if wrist is None:
            raise PlopError("The wrist camera is not usable.", where=where, found="no wrist camera")
        first, last = _span(span, trajectory.rows, where, warnings)
        good = (wrist.frame_of_row >= 0) & np.isfinite(wrist.world_from_cam).all((1, 2))
        rows = first + np.flatnonzero(good[first : last + 1])
        if not len(rows):
            raise PlopError("No frame of the scan is usable.", where=where, found="no row with frame and pose")
    except PlopError as error:
        warnings += [*error.noticed, f"no scan: {error.problem} ({error.where}; found: {error.found})"]
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), choice.scan_frames)).round().astype(int))]
    flange = poses_at(trajectory.flange, trajectory.robot_time_ms, wrist.capture_ms[rows])
    return DroidScan(name, wrist, rows, flange @ flange_from_tool)


def _open_cameras_wrist(
    folder: DroidFolder, trajectory: DroidTrajectory, options: DroidOptions, warnings: list[str]
) -> DroidCamera | None:
    for serial, kind in sorted(trajectory.camera_type.items()):
        if kind == 0:
            camera, more = open_camera(folder, trajectory, serial, options)
            warnings += more
            return camera
    return None


def _metadata_serials(folder: DroidFolder) -> dict[str, int]:
    """Return cameras by type from the metadata."""
    roles = {"wrist_cam_serial": 0, "ext1_cam_serial": 1, "ext2_cam_serial": 2}
    return {str(folder.metadata[key]): kind for key, kind in roles.items() if folder.metadata.get(key)}
