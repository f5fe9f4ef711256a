"""One camera of a DROID episode: its video, its poses in the base frame and its depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import cv2
import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError, remembering
from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.droid.align import capture_times, frames_of_rows, poses_at
from plop.recordings.readers.droid.depth import (
    DepthSource,
    ExportedDepth,
    StereoDepth,
    ZedDepth,
    find_svo,
    zed_sdk_present,
)
from plop.recordings.readers.droid.intrinsics import find_intrinsics, side_of_episode
from plop.recordings.readers.droid.layout import DroidFolder
from plop.recordings.readers.droid.pose import check_pose, pose_from_json
from plop.recordings.readers.droid.trajectory import DroidTrajectory
from plop.recordings.readers.droid.video import DroidVideo, find_video
from plop.recordings.readers.side_pictures import find_side_pictures
from plop.setting_kinds import Formerly, Range, Settings, Unit

BASELINES_M = {"ZED 2": 0.120, "ZED Mini": 0.063}
"""Nominal stereo baseline [m]."""


@dataclass(frozen=True)
class DroidCameraSettings(Settings):
    """Settings of DROID cameras; the defaults are defined only here."""

    exterior_focal_px: Annotated[float, Range(0, 1e5), Unit("px")] = 0.0
    """Focal length of exterior cameras without intrinsics, at 1280 px width (ZED 2: about 530); 0 = none."""
    wrist_focal_px: Annotated[float, Range(0, 1e5), Unit("px")] = 0.0
    """Focal length of a wrist camera without intrinsics, at 1280 px width (ZED Mini: about 733); 0 = none."""
    baseline_m: Annotated[float, Range(0, 1), Unit("m")] = 0.0
    """Baseline of every stereo camera; 0 = from its left and right extrinsics."""
    match_width: Annotated[int, Range(16, 8192), Unit("px")] = 640
    """Width at which stereo pairs are matched."""
    nearest_m: Annotated[float, Range(0.01, 100), Unit("m")] = 0.2
    """Smallest depth in stereo matching."""
    farthest_m: Annotated[float, Range(0.01, 1000), Unit("m")] = 2.5
    """Largest stereo depth; larger values are discarded."""
    delay_ms: Annotated[float, Range(-1e4, 1e4), Unit("ms"), Formerly("camera_delay_ms")] = 0.0
    """Delay between the capture of an image and its time stamp; `plop calibrate` measures it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.farthest_m < self.nearest_m:
            raise PlopError(
                "The largest depth is smaller than the smallest.",
                where="cameras.farthest_m, cameras.nearest_m",
                expected=f"farthest_m of {self.nearest_m:g} m or more",
                found=f"{self.farthest_m:g} m",
                fix="Raise farthest_m, or lower nearest_m.",
            )


@dataclass(frozen=True)
class DroidOptions:
    """Sources for reading DROID cameras."""

    settings: DroidCameraSettings
    intrinsics: dict[str, Any]
    """Intrinsics of a file beside the episodes, by serial number."""
    intrinsics_name: str
    """That file."""
    extrinsics: dict[str, Any]
    """Poses of a file beside the episodes, by episode."""
    extrinsics_name: str


@dataclass(frozen=True)
class DroidCamera:
    """A usable camera."""

    serial: str
    wrist: bool
    video: DroidVideo
    frame_of_row: np.ndarray
    """Frame number of every row, shape [T]; -1 none."""
    capture_ms: np.ndarray
    """Capture time of the row's image, shape [T] [ms since the trajectory's origin]; NaN unknown."""
    world_from_cam: np.ndarray
    """Pose at capture time of every row, shape [T, 4, 4]."""
    intrinsics: np.ndarray
    """K of the video, pixel centres at half-integers, shape [3, 3] [px]."""
    depth: DepthSource
    stored_pose6: np.ndarray | None = None
    """The six stored numbers of a fixed camera's pose, shape [6]."""

    def size(self, longest: int) -> tuple[int, int]:
        """Width and height after downscaling so that the longest side is at most `longest` [px]."""
        scale = min(1.0, longest / max(self.video.width, self.video.height))
        return max(1, round(self.video.width * scale)), max(1, round(self.video.height * scale))

    def intrinsics_at(self, width: int, height: int) -> np.ndarray:
        """K for another image size, shape [3, 3]."""
        return self.intrinsics * np.array([[width / self.video.width], [height / self.video.height], [1.0]])

    def images(self, rows: np.ndarray, width: int, height: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Read the images of some rows, in order.

        Args:
            rows: Ascending rows that have a frame, shape [N].
            width: [px]
            height: [px]

        Yields:
            rgb [H, W, 3] uint8 and depth [H, W] float32 [m] (0 = not measured).
        """
        frames = self.frame_of_row[rows]
        for frame, (left, right) in zip(frames, self.video.read(frames), strict=True):
            depth = self.depth.depth_m(int(frame), left, right)
            yield (
                cv2.resize(left, (width, height), interpolation=cv2.INTER_AREA),
                cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST),
            )


def open_camera(
    episode: DroidFolder, trajectory: DroidTrajectory, serial: str, options: DroidOptions
) -> tuple[DroidCamera, list[str]]:
    """Collect everything that is known about a camera.

    Returns:
        The camera and warnings.

    Raises:
        PlopError: The camera cannot be used: no video, no pose, no intrinsics, no depth or no common clock. It has
            the warnings collected before.
    """
    warnings: list[str] = []
    with remembering(warnings):
        return _opened(episode, trajectory, serial, options, warnings), warnings


def _opened(
    episode: DroidFolder, trajectory: DroidTrajectory, serial: str, options: DroidOptions, warnings: list[str]
) -> DroidCamera:
    if serial in trajectory.bad_clocks:
        raise trajectory.bad_clocks[serial]
    wrist = trajectory.camera_type[serial] == 0
    exported = episode.recordings / "depth" / serial
    use_exported = exported.is_dir() and any(exported.glob("*.png"))
    video, more = find_video(episode.recordings, serial, stereo=not use_exported)
    warnings += more
    if video is None:
        svo = find_svo(episode.recordings, serial)
        raise PlopError(
            "A camera has no video.",
            where=f"{episode.recordings}: {serial}.mp4",
            expected=f"MP4/{serial}.mp4 or MP4/{serial}-stereo.mp4",
            found=f"only {svo.name}" if svo else "; ".join(warnings) or "nothing",
            fix="Convert the SVO to MP4." if svo else "Copy the files again.",
        )
    unknown = np.full(trajectory.rows, np.nan)
    received = trajectory.received_ms.get(serial, unknown)
    stamps = episode.recordings / "MP4" / f"{serial}_timestamps.json"
    frame_of_row, more = frames_of_rows(received, video.frames, stamps, trajectory.origin_ns, video.path)
    warnings += more
    captured = capture_times(trajectory.captured_ms.get(serial, unknown), received, trajectory.robot_time_ms)
    captured = captured - options.settings.delay_ms
    poses, stored, offset_pair, more = _poses(episode, trajectory, serial, wrist, captured, options)
    warnings += more
    focal = options.settings.wrist_focal_px if wrist else options.settings.exterior_focal_px
    intrinsics, more = find_intrinsics(
        episode,
        serial,
        (video.width, video.height),
        stored=trajectory.intrinsics,
        side=options.intrinsics,
        side_name=options.intrinsics_name,
        focal_px=focal,
    )
    warnings += more
    if use_exported:
        pictures = find_side_pictures(exported, video.frames, what="depth images", cause=Cause.DEPTH)
        warnings += [Noticed(note, Cause.DEPTH, "Check the numbers of the depth images.") for note in pictures.notes]
        depth: DepthSource = ExportedDepth(pictures)
    else:
        depth, more = _computed_depth(episode, serial, video, intrinsics, offset_pair, options)
        warnings += more
    return DroidCamera(serial, wrist, video, frame_of_row, captured, poses, intrinsics, depth, stored)


def _poses(
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
    pair = _pair({key: _first(value) for key, value in trajectory.extrinsics.items()}, serial)
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
        moved = float(np.nanmax(np.linalg.norm(own[:, :3] - _first(own)[:3], axis=1)))
        if moved > 1e-3:
            warnings.append(
                Noticed(
                    f"{where}: a fixed camera moves by {1000 * moved:.1f} mm; its first pose is used",
                    Cause.EXTRINSICS,
                    "Check the pose of this camera.",
                )
            )
        own = np.repeat(_first(own)[None], trajectory.rows, 0)
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


def _computed_depth(
    episode: DroidFolder,
    serial: str,
    video: DroidVideo,
    intrinsics: np.ndarray,
    pair: tuple[np.ndarray, np.ndarray] | None,
    options: DroidOptions,
) -> tuple[DepthSource, list[str]]:
    if video.stereo:
        settings, focal_720p = options.settings, intrinsics[0, 0] * 1280 / video.width
        baseline, warnings = _baseline(f"{episode.name}: camera {serial}", pair, focal_720p, settings.baseline_m)
        depth = StereoDepth(
            intrinsics[0, 0],
            baseline,
            video.width,
            match_width=settings.match_width,
            nearest_m=settings.nearest_m,
            farthest_m=settings.farthest_m,
        )
        return depth, warnings
    svo = find_svo(episode.recordings, serial)
    if svo is not None and zed_sdk_present():
        return ZedDepth(svo), []
    others = sorted(path.name for path in (episode.recordings / "depth" / serial).glob("*"))
    raise PlopError(
        "A camera has no depth.",
        where=f"{episode.recordings}: camera {serial}",
        expected=f"depth/{serial}/<frame>.png, MP4/{serial}-stereo.mp4, or SVO and ZED SDK",
        found=f"{video.path.name} (one eye)"
        + (f", {svo.name} but no pyzed" if svo else "")
        + (f", depth/{serial}/{others[0]} and others that are not PNG files" if others else ""),
        fix="Export depth as 16-bit PNG, np.uint16(np.round(1000 * metres)), or add the stereo video.",
        cause=Cause.DEPTH,
    )


def _baseline(
    where: str, pair: tuple[np.ndarray, np.ndarray] | None, focal_720p: float, given: float
) -> tuple[float, list[str]]:
    if given > 0:
        return given, []
    nominal = BASELINES_M["ZED 2" if focal_720p < 630 else "ZED Mini"]
    if pair is None:
        return nominal, [f"{where}: extrinsics of one eye are missing; {1000 * nominal:.0f} mm baseline assumed"]
    measured = float(np.linalg.norm(pair[0][:3] - pair[1][:3]))
    if not 0.01 < measured < 0.5:
        raise PlopError(
            "The stereo baseline is not plausible.",
            where=where,
            expected="1 to 50 cm",
            found=f"{measured:.4f} m",
            fix="Correct the extrinsics, or set cameras.baseline_m.",
        )
    nearest = min(BASELINES_M.values(), key=lambda built: abs(built - measured))
    if abs(measured - nearest) > 0.02 * nearest:
        text = (
            f"{where}: extrinsics give a baseline of {1000 * measured:.1f} mm, that of a ZED is "
            f"{1000 * nearest:.0f} mm: depth may be wrong by {100 * abs(measured / nearest - 1):.0f} %; "
            "set cameras.baseline_m if you know it"
        )
        return measured, [Noticed(text, Cause.DEPTH, "Set cameras.baseline_m.")]
    return measured, []


def _pair(poses: dict[str, np.ndarray], serial: str) -> tuple[np.ndarray, np.ndarray] | None:
    left, right = poses.get(f"{serial}_left"), poses.get(f"{serial}_right")
    if left is None or right is None or not (np.isfinite(left).all() and np.isfinite(right).all()):
        return None
    return left, right


def _first(poses: np.ndarray) -> np.ndarray:
    good = np.isfinite(poses).all(1)
    return poses[np.argmax(good)] if good.any() else np.full(6, np.nan)
