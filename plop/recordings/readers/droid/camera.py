"""One camera of a DROID episode: its video, its poses in the base frame and its depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError, remembering
from plop.recordings.readers.droid.align import capture_times, frames_of_rows
from plop.recordings.readers.droid.camera_pose import camera_poses
from plop.recordings.readers.droid.camera_settings import DroidOptions
from plop.recordings.readers.droid.depth import (
    DepthSource,
    ExportedDepth,
    StereoDepth,
    ZedDepth,
    find_svo,
    zed_sdk_present,
)
from plop.recordings.readers.droid.intrinsics import find_intrinsics
from plop.recordings.readers.droid.layout import DroidFolder
from plop.recordings.readers.droid.trajectory import DroidTrajectory
from plop.recordings.readers.droid.video import DroidVideo, find_video
from plop.recordings.readers.side_pictures import find_side_pictures

BASELINES_M = {"ZED 2": 0.120, "ZED Mini": 0.063}
"""Nominal stereo baseline [m]."""


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
    poses, stored, offset_pair, more = camera_poses(episode, trajectory, serial, wrist, captured, options)
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
