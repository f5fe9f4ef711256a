"""Write MP4 files frame by frame (H.264, through imageio's ffmpeg)."""

from __future__ import annotations

import os
from collections.abc import Generator
from pathlib import Path
from typing import Self

import imageio_ffmpeg
import numpy as np

from plop.artifacts.atomic_file import scratch_of
from plop.errors import PlopError

# One thread and no metadata: the same frames give the same bytes.
_STEADY = [
    "-threads",
    "1",
    "-fflags",
    "+bitexact",
    "-flags:v",
    "+bitexact",
    "-map_metadata",
    "-1",
    "-crf",
    "18",
    "-movflags",
    "+faststart",
    "-f",
    "mp4",
]


class VideoWriter:
    """Write a video; use as a context manager. The file appears when the block ends without error.

    Args:
        path: Path of the video, `<name>.mp4`.
        rate_hz: Frames per second of the video.
    """

    def __init__(self, path: Path, *, rate_hz: float) -> None:
        self.path = path
        self.rate_hz = rate_hz
        self._scratch = scratch_of(path)
        self._size: tuple[int, int] | None = None
        self._pipe: Generator[None, np.ndarray | None, None] | None = None

    def __enter__(self) -> Self:
        return self

    def append(self, picture: np.ndarray) -> None:
        """Add one picture, uint8, shape [H, W, 3], both sides even, all of one size.

        Raises:
            PlopError: The encoder does not run, or the disk is full.
        """
        size = (picture.shape[1], picture.shape[0])
        if self._size not in (None, size) or size[0] % 2 or size[1] % 2:
            raise ValueError(f"pictures of one even size expected, found {size} after {self._size}")
        try:
            if self._pipe is None:
                self._size = size
                self._pipe = imageio_ffmpeg.write_frames(
                    str(self._scratch),
                    size,
                    fps=self.rate_hz,
                    codec="libx264",
                    quality=None,
                    macro_block_size=2,
                    output_params=_STEADY,
                    ffmpeg_log_level="error",
                )
                next(self._pipe)
            self._pipe.send(np.ascontiguousarray(picture))
        except (OSError, RuntimeError) as error:
            raise self._failure(error) from error

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._pipe is not None:
            self._pipe.close()
        if kind is not None:
            self._scratch.unlink(missing_ok=True)
        elif self._scratch.is_file() and self._scratch.stat().st_size:
            os.replace(self._scratch, self.path)
        else:
            raise self._failure("no video was written")

    def _failure(self, error: object) -> PlopError:
        return PlopError(
            "The video cannot be written.",
            where=self.path,
            expected="a working ffmpeg and free disk space",
            found=str(error).splitlines()[0],
            fix="Free some space or reinstall imageio-ffmpeg.",
        )
