"""Read DROID's videos in order: left eye, or left|right side by side."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from plop.causes import Cause, Noticed
from plop.errors import PlopError

# Suppress FFmpeg's own messages on a damaged file; cv2 reads this when it opens its first video.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

STACKED_ASPECT = (0.6, 1.25)
"""Aspect ratio of two vertically stacked eyes (one eye: 1.2 to 2.5); some single images have it, too."""
ALIKE = 0.72
"""Smallest median correlation of blocks of two eyes: 0.78 to 0.87 on rendered pairs with noise, at most 0.67 on the
halves of about forty single images of such an aspect ratio."""
STEREO_ASPECT = 2.4
"""Smallest aspect ratio of an image with both eyes (HD720: 1.78 for one eye, 3.56 for two)."""


@dataclass(frozen=True)
class DroidVideo:
    """One video file, measured by decoding it: its header is not reliable."""

    path: Path
    frames: int
    """Frames that decode."""
    width: int
    """Width of one eye [px]."""
    height: int
    """[px]"""
    stereo: bool
    """Both eyes, side by side."""
    turned_deg: int = 0
    """Rotation by the file's rotation flag, already applied [deg]."""

    def read(self, indices: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
        """Decode some frames in one pass.

        Args:
            indices: Ascending frame numbers, shape [N].

        Yields:
            Left and right image per index, [H, W, 3] uint8 RGB; right is None for a single eye.

        Raises:
            PlopError: A frame does not decode.
        """
        capture = cv2.VideoCapture(str(self.path))
        try:
            position = 0
            for index in np.asarray(indices):
                while position < index and capture.grab():
                    position += 1
                good, picture = capture.read() if position == index else (False, None)
                if not good or picture is None:
                    raise PlopError(
                        "A frame of a video cannot be decoded.",
                        where=f"{self.path}: frame {index}",
                        expected=f"{self.frames} frames",
                        found=f"the end after {position}",
                        fix="Copy the file again, or leave the episode out.",
                    )
                position += 1
                rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
                yield (rgb[:, : self.width], rgb[:, self.width : 2 * self.width]) if self.stereo else (rgb, None)
        finally:
            capture.release()


def open_video(path: Path) -> DroidVideo:
    """Measure a video by decoding it once.

    Raises:
        PlopError: The file cannot be opened, contains no frame, or has the eyes stacked vertically.
    """
    capture = cv2.VideoCapture(str(path)) if path.stat().st_size else None
    try:
        good, first = capture.read() if capture is not None else (False, None)
        if capture is None or not good or first is None:
            raise PlopError(
                "A video cannot be opened.",
                where=path,
                expected="an MP4 file with frames",
                found=f"{path.stat().st_size} bytes that do not decode",
                fix="Copy the file again.",
            )
        turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
        frames = 1
        while capture.grab():
            frames += 1
    finally:
        if capture is not None:
            capture.release()
    height, width = first.shape[:2]
    if _stacked(first):
        raise PlopError(
            "A video has both eyes stacked vertically.",
            where=path,
            expected="one eye, or both side by side (left | right)",
            found=f"{width}x{height} px with two similar halves",
            fix=f"Put them side by side: ffmpeg -i {path.name} -vf stereo3d=abl:sbsl <new file> "
            "(abr:sbsl where the right eye is above).",
            cause=Cause.PICTURES,
        )
    stereo = width / height > STEREO_ASPECT
    return DroidVideo(path, frames, width // 2 if stereo else width, height, stereo, turned)


def _stacked(picture: np.ndarray) -> bool:
    """Return whether the halves of an image are two eyes: every block of one is in the other, in the same rows."""
    height, width = picture.shape[:2]
    if not STACKED_ASPECT[0] < width / height < STACKED_ASPECT[1]:
        return False
    small = cv2.resize(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), (128, 128), interpolation=cv2.INTER_AREA)
    upper, lower = small[:64].astype(np.float32), small[64:].astype(np.float32)
    scores = []
    for y in range(4, 48, 8):
        for x in range(0, 113, 8):
            block = np.ascontiguousarray(upper[y : y + 12, x : x + 16])
            if block.std() > 2:
                strip = lower[y - 1 : y + 13, max(0, x - 32) : x + 48]
                scores.append(cv2.matchTemplate(strip, block, cv2.TM_CCOEFF_NORMED).max())
    return len(scores) >= 10 and bool(np.median(scores) > ALIKE)


def find_video(recordings: Path, serial: str, *, stereo: bool) -> tuple[DroidVideo | None, list[str]]:
    """Choose the file of a camera.

    A `-stereo` suffix is not reliable: the shape of the image decides.

    Args:
        recordings: The episode's folder of recordings.
        serial: The camera.
        stereo: Prefer a file with both eyes.

    Returns:
        The video (None when there is none) and warnings about skipped files.

    Raises:
        PlopError: A file has both eyes stacked vertically.
    """
    warnings: list[str] = []
    order = (f"{serial}-stereo.mp4", f"{serial}.mp4") if stereo else (f"{serial}.mp4", f"{serial}-stereo.mp4")
    single: DroidVideo | None = None
    for name in order:
        path = recordings / "MP4" / name
        if not path.is_file():
            continue
        try:
            video = open_video(path)
        except PlopError as error:
            if error.cause is Cause.PICTURES:
                raise
            warnings.append(f"{path}: {error.problem} ({error.found})")
            continue
        if video.turned_deg:
            warnings.append(
                Noticed(
                    f"{path}: its rotation flag rotates the images by {video.turned_deg} deg; "
                    "intrinsics, depth and pose must be those of the rotated image",
                    Cause.PICTURES,
                    "Write the video without the flag: ffmpeg -noautorotate.",
                )
            )
        if video.stereo != name.endswith("-stereo.mp4"):
            warnings.append(f"{path}: {'both eyes' if video.stereo else 'one eye'}, in contradiction to its name")
        if video.stereo == stereo:
            return video, warnings
        single = single or video
    return single, warnings
