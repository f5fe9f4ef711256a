"""Write synthetic episodes in DROID's raw layout: for tests, and for simulators in place of the robot."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from plop.recordings.readers.droid.align import CAPTURE_LATENCY_MS

STEP_MS = 67
"""One control step [ms]."""
HEADER_FPS = 60
"""Frame rate in DROID's MP4 headers; not a clock."""


@dataclass(frozen=True)
class RawCamera:
    """One camera to write."""

    serial: str
    kind: int
    """0 wrist, 1 or 2 exterior."""
    left: Sequence[np.ndarray]
    """One image per row, [H, W, 3] uint8 RGB."""
    pose6: np.ndarray
    """Left eye: camera in base (exterior) or camera in flange (wrist), [x, y, z, a, b, c]."""
    right: Sequence[np.ndarray] | None = None
    right_pose6: np.ndarray | None = None
    intrinsics: np.ndarray | None = None
    """K with pixel centres at integers, as DROID stores it, shape [3, 3] [px]; None leaves it out."""
    depth_m: Sequence[np.ndarray] | None = None
    """One depth image per row, [H, W] [m]; written as uint16 millimetres."""


def write_droid_episode(
    root: Path,
    cameras: Sequence[RawCamera],
    flange6: np.ndarray,
    *,
    lab: str = "SIM",
    user: str = "abcd1234",
    outcome: str = "success",
    moment: datetime = datetime(2023, 8, 6, 22, 13, 4),
    pose_lag_ms: int = 0,
    notes: dict[str, Any] | None = None,
) -> Path:
    """Write one episode.

    Args:
        root: The raw folder; the episode goes to <lab>/<outcome>/<date>/<time> in it.
        cameras: The cameras, with one image per row.
        flange6: Pose of the flange in the base per row, shape [T, 6], metres and radians.
        lab: Name of the lab.
        user: Eight characters.
        outcome: "success" or "failure".
        moment: Start of the episode.
        pose_lag_ms: Lead of the robot's state over the images [ms].
        notes: Content of plop_episode.json; None writes none.

    Returns:
        The episode's folder.
    """
    stamp = moment.strftime("%Y-%m-%d-%Hh-%Mm-%Ss")
    folder = root / lab / outcome / moment.strftime("%Y-%m-%d") / moment.ctime().replace(" ", "_")
    (folder / "recordings" / "MP4").mkdir(parents=True)
    start_ms = int(moment.replace(tzinfo=UTC).timestamp() * 1000)
    captured = start_ms + STEP_MS * np.arange(len(flange6))
    _write_trajectory(folder / "trajectory.h5", cameras, np.asarray(flange6, float), captured, pose_lag_ms)
    for camera in cameras:
        _write_pictures(folder / "recordings", camera, captured + CAPTURE_LATENCY_MS)
    roles = {"wrist": 0, "ext1": 1, "ext2": 2}
    serials = {role: next((c for c in cameras if c.kind == kind), None) for role, kind in roles.items()}
    metadata: dict[str, Any] = {
        "uuid": f"{lab}+{user}+{stamp}",
        "lab": lab,
        "user_id": user,
        "date": stamp[:10],
        "droid_version": 1.1,
        "success": outcome == "success",
        "current_task": "cut",
        "trajectory_length": len(flange6),
    }
    for role, camera_of_role in serials.items():
        if camera_of_role is not None:
            metadata[f"{role}_cam_serial"] = camera_of_role.serial
            metadata[f"{role}_cam_extrinsics"] = [float(x) for x in camera_of_role.pose6]
            metadata[f"{role}_mp4_path"] = f"recordings/MP4/{camera_of_role.serial}.mp4"
    (folder / f"metadata_{metadata['uuid']}.json").write_text(json.dumps(metadata, indent=1))
    if notes is not None:
        (folder / "plop_episode.json").write_text(json.dumps(notes, indent=1))
    return folder


def _write_trajectory(
    path: Path, cameras: Sequence[RawCamera], flange6: np.ndarray, captured: np.ndarray, pose_lag_ms: int
) -> None:
    rows = len(flange6)
    state, clock = "observation/robot_state", "observation/timestamp"
    content: dict[str, np.ndarray] = {
        "action/cartesian_position": flange6,
        "action/joint_position": np.zeros((rows, 7)),
        "action/gripper_position": np.ones(rows),
        f"{state}/cartesian_position": flange6,
        f"{state}/joint_positions": np.zeros((rows, 7)),
        f"{state}/gripper_position": np.ones(rows),
        "observation/controller_info/movement_enabled": np.ones(rows, bool),
        f"{clock}/skip_action": np.zeros(rows, bool),
        f"{clock}/control/step_start": captured - pose_lag_ms - 2,
        f"{clock}/robot_state/read_start": captured - pose_lag_ms - 1,
        f"{clock}/robot_state/read_end": captured - pose_lag_ms,
    }
    for camera in cameras:
        serial, suffix = camera.serial, "_gripper_offset" if camera.kind == 0 else ""
        content[f"observation/camera_type/{serial}"] = np.full(rows, camera.kind)
        for eye, pose in (("left", camera.pose6), ("right", camera.right_pose6)):
            if pose is not None:
                key = f"observation/camera_extrinsics/{serial}_{eye}{suffix}"
                content[key] = np.repeat(np.asarray(pose, float)[None], rows, axis=0)
            if camera.intrinsics is not None:
                key = f"observation/camera_intrinsics/{serial}_{eye}"
                content[key] = np.repeat(camera.intrinsics[None], rows, axis=0)
        received = captured + CAPTURE_LATENCY_MS
        for name, times in (
            ("read_start", received - 3),
            ("read_end", received + 2),
            ("frame_received", received),
            ("estimated_capture", captured),
        ):
            content[f"{clock}/cameras/{serial}_{name}"] = times
    with h5py.File(path, "w") as file:
        file.attrs.update(building="N/A", scene_id=-1, current_task="cut", success=True, failure=False)
        for key, values in content.items():
            file.create_dataset(key, data=values, maxshape=(None, *values.shape[1:]), track_times=False)


def _write_pictures(recordings: Path, camera: RawCamera, received: np.ndarray) -> None:
    folder = recordings / "MP4"
    write_video(folder / f"{camera.serial}.mp4", camera.left)
    if camera.right is not None:
        pairs = [np.concatenate(pair, axis=1) for pair in zip(camera.left, camera.right, strict=True)]
        write_video(folder / f"{camera.serial}-stereo.mp4", pairs)
    (folder / f"{camera.serial}_timestamps.json").write_text(json.dumps([int(x) for x in received]))
    if camera.depth_m is not None:
        target = recordings / "depth" / camera.serial
        target.mkdir(parents=True)
        for frame, depth in enumerate(camera.depth_m):
            cv2.imwrite(str(target / f"{frame:06d}.png"), np.round(depth * 1000).clip(0, 65534).astype(np.uint16))


def write_video(path: Path, frames: Sequence[np.ndarray]) -> None:
    """Write RGB images [H, W, 3] uint8 as MPEG-4, with 60 fps in the header as in DROID's files."""
    height, width = frames[0].shape[:2]
    code = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(path), code, HEADER_FPS, (width, height))
    try:
        for frame in frames:
            writer.write(cv2.cvtColor(np.ascontiguousarray(frame), cv2.COLOR_RGB2BGR))
    finally:
        writer.release()
