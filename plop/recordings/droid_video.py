"""Read DROID's videos in order: left eye, or left|right side by side."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from plop.errors import PlopError

# FFmpeg's own lines on a damaged file would stand before plop's error; cv2 reads this when it opens its first video.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

STEREO_ASPECT = 2.4
"""Width / height above which a picture holds both eyes (HD720: 1.78 for one eye, 3.56 for two)."""


@dataclass(frozen=True)
class DroidVideo:
    """One video file, measured by decoding it: its header is not to be trusted."""

    path: Path
    frames: int
    """Frames that decode."""
    width: int
    """Width of one eye [px]."""
    height: int
    """[px]"""
    stereo: bool
    """Both eyes, side by side."""

    def read(self, indices: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
        """Decode some frames in one pass.

        Args:
            indices: Ascending frame numbers, shape [N].

        Yields:
            Left and right picture per index, [H, W, 3] uint8 RGB; right is None for a single eye.

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
                    raise PlopError("A frame of a video cannot be decoded.", where=f"{self.path}: frame {index}",
                                    expected=f"{self.frames} frames", found=f"the end after {position}",
                                    fix="Copy the file again, or leave the episode out.")  # fmt: skip
                position += 1
                rgb = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
                yield (rgb[:, : self.width], rgb[:, self.width : 2 * self.width]) if self.stereo else (rgb, None)
        finally:
            capture.release()


def open_video(path: Path) -> DroidVideo:
    """Measure a video by walking through it once.

    Raises:
        PlopError: The file cannot be opened or holds no frame.
    """
    capture = cv2.VideoCapture(str(path)) if path.stat().st_size else None
    try:
        good, first = capture.read() if capture is not None else (False, None)
        if capture is None or not good or first is None:
            raise PlopError("A video cannot be opened.", where=path, expected="an MP4 file with frames",
                            found=f"{path.stat().st_size} bytes that do not decode",
                            fix="Copy the file again.")  # fmt: skip
        frames = 1
        while capture.grab():
            frames += 1
    finally:
        if capture is not None:
            capture.release()
    height, width = first.shape[:2]
    stereo = width / height > STEREO_ASPECT
    return DroidVideo(path, frames, width // 2 if stereo else width, height, stereo)


def find_video(recordings: Path, serial: str, *, stereo: bool) -> tuple[DroidVideo | None, list[str]]:
    """Choose the file of a camera.

    A `-stereo` suffix is no proof and its absence neither: the picture's shape decides.

    Args:
        recordings: The episode's folder of recordings.
        serial: The camera.
        stereo: Both eyes are wanted when they are there.

    Returns:
        The video (None when there is none) and warnings about files that were passed over.
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
            warnings.append(f"{path}: {error.problem} ({error.found})")
            continue
        if video.stereo != name.endswith("-stereo.mp4"):
            warnings.append(f"{path}: {'both eyes' if video.stereo else 'one eye'}, whatever the name says")
        if video.stereo == stereo:
            return video, warnings
        single = single or video
    return single, warnings
