"""Overview of a set of recordings, from the files themselves, so that a resumed run gives the same."""

from __future__ import annotations

from typing import Any

from plop.geometry.view import MaskLabel
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet


def overview(recordings: RecordingSet) -> tuple[dict[str, Any], list[dict[str, Any]], list[str]]:
    """Describe a set.

    Returns:
        Figures of the whole set, one row per episode, and warnings of lost sight or missing episodes.
    """
    table, warnings = [], []
    for what, kept in (("training", recordings.train), ("the test", recordings.test)):
        if not kept:
            warnings.append(f"No episode is left for {what}.")
    for name in recordings.names:
        with recordings.open(name) as recording:
            seen = {camera: _fewest_object_pixels(recording, camera) for camera in recording.camera_names}
            times = recording.time_s
        warnings += [
            f"{name}: the object leaves the view of {camera}." for camera, pixels in seen.items() if not pixels
        ]
        table.append(
            {
                "episode": name,
                "split": "train" if name in recordings.train else "test",
                "frames": len(times),
                "seconds": round(float(times[-1] - times[0]), 3),
                "cameras": len(seen),
                "object_px_min": min(seen.values()),
                "megabytes": round(recordings.path(name).stat().st_size / 1e6, 2),
            }
        )
    figures = {
        "environment": recordings.environment,
        "train": len(recordings.train),
        "test": len(recordings.test),
        "skipped": len(recordings.skipped),
        "frames": sum(int(row["frames"]) for row in table),
    }
    return figures, table, warnings


def _fewest_object_pixels(recording: Recording, camera: str) -> int:
    return min(int((recording.mask(camera, frame) == MaskLabel.OBJECT).sum()) for frame in range(len(recording)))
