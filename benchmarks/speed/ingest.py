"""Speed of rendering simulated episodes and of reading recordings back."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.speed.block import CAMERAS, FRAMES, raw_block, record, recorded_block
from benchmarks.speed.measure import median_ms


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {"ingest_128_images_per_s": ingest_rate, "recording_read_one_frame_ms": read_one_frame_ms}


def ingest_rate() -> float:
    """Images of 128 x 128 px, 3 x 3 rays a pixel, rendered and written a second, by the whole stage."""
    with raw_block() as raw:

        def work() -> None:
            with tempfile.TemporaryDirectory() as out:
                record(raw, Path(out))

        return FRAMES * CAMERAS / (median_ms(work, repeats=3, warm_up=1) / 1000)


def read_one_frame_ms() -> float:
    """Colour, depth, mask and calibration of one frame of one camera, a different frame each time."""
    from plop.recordings.recording import Recording

    with recorded_block() as path, Recording(path) as recording:
        views = [(name, frame) for frame in range(FRAMES) for name in recording.camera_names]
        return median_ms(lambda: [recording.view(*view) for view in views], warm_up=1) / len(views)
