"""Where the poses of a DROID camera come from: trajectory, side file or metadata."""

from __future__ import annotations

import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.droid.align import poses_at
from plop.recordings.readers.droid.camera_settings import DroidOptions
from plop.recordings.readers.droid.intrinsics import side_of_episode
from plop.recordings.readers.droid.layout import DroidFolder
from plop.recordings.readers.droid.pose import check_pose, pose_from_json
from plop.recordings.readers.droid.trajectory import DroidTrajectory, first_finite


def camera_poses(
    episode: DroidFolder,
    trajectory: DroidTrajectory,
    serial: str,
    wrist: bool,
    captured: np.ndarray,
    options: DroidOptions,
) -> tuple[np.ndarray, np.ndarray | None, tuple[np.ndarray, np.ndarray] | None, list[str]]:
    """Return poses [T, 4, 4], a fixed camera's as stored [6], the two 6-vectors that give the baseline, warnings."""
    clock = trajectory.robot_time_ms
    where = f"{trajectory.path}:/observation/camera_extrinsics/{serial}_left"
    if wrist:
        pair = _pair(trajectory.gripper_offset, serial)
        offset = trajectory.gripper_offset.get(f"{serial}_left")
        if offset is not None and np.isfinite(offset).all():
            check_pose(offset, where=f"{where}_gripper_offset", what="camera")
            flange = poses_at(trajectory.flange, clock, captured)
            return flange @ pose_from_euler_xyz(offset), None, pair, []
    own = trajectory.extrinsics.get(f"{serial}_left", np.full((trajectory.rows, 6), np.nan))
    pair = _pair({key: first_finite(value) for key, value in trajectory.extrinsics.items()}, serial)
    side = side_of_episode(episode, options.extrinsics).get(serial)
    if not wrist and side is not None:
        given = pose_from_json(side, where=f"{options.extrinsics_name}: {serial}", what="camera")
        pose = pose_from_euler_xyz(given)
        note = f"{episode.name}: pose of camera {serial} from {options.extrinsics_name}"
        return np.repeat(pose[None], trajectory.rows, 0), given, pair, [note]
    warnings: list[str] = []
    if not np.isfinite(own).all(1).any() and not wrist:
        own, warnings = _from_metadata(episode, trajectory, serial, where)
    if not np.isfinite(own).all(1).any():
        raise PlopError(
            "A camera has no pose.",
            where=where,
            expected="camera -> base, metres and radians",
            found="no pose, and none in metadata or side files",
            fix="Add cam2base_extrinsics.json, or leave this camera out.",
        )
    check_pose(own, where=where, what="camera")
    if not wrist:
        moved = float(np.nanmax(np.linalg.norm(own[:, :3] - first_finite(own)[:3], axis=1)))
        if moved > 1e-3:
            warnings.append(
                Noticed(
                    f"{where}: a fixed camera moves by {1000 * moved:.1f} mm; its first pose is used",
                    Cause.EXTRINSICS,
                    "Check the pose of this camera.",
                )
            )
        own = np.repeat(first_finite(own)[None], trajectory.rows, 0)
        return pose_from_euler_xyz(own), own[0], pair, warnings
    note = f"{where}_gripper_offset: missing; the row's own pose is used"
    return poses_at(own, clock, captured), None, pair, [note]


def _from_metadata(
    episode: DroidFolder, trajectory: DroidTrajectory, serial: str, where: str
) -> tuple[np.ndarray, list[str]]:
    for role in ("ext1", "ext2"):
        key = f"{role}_cam_extrinsics"
        pose = episode.metadata.get(key)
        if str(episode.metadata.get(f"{role}_cam_serial")) == serial and pose is not None:
            given = pose_from_json(pose, where=f"{episode.folder}: metadata, {key}", what="camera")
            own = np.repeat(given[None], trajectory.rows, 0)
            return own, [f"{where}: missing; {role}_cam_extrinsics of the metadata is used"]
    return np.full((trajectory.rows, 6), np.nan), []


def _pair(poses: dict[str, np.ndarray], serial: str) -> tuple[np.ndarray, np.ndarray] | None:
    left, right = poses.get(f"{serial}_left"), poses.get(f"{serial}_right")
    if left is None or right is None or not (np.isfinite(left).all() and np.isfinite(right).all()):
        return None
    return left, right
