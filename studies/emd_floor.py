"""What EMD reads for clouds whose distance is known: `python -m studies.emd_floor RECORDING.h5`.

Shifts one half (x > 0) of frame 0's measured cloud, so that the true EMD is shift times share, and
samples both clouds with common random numbers and independently.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from plop.metrics.clouds import Cloud, back_project_all, paired_samples
from plop.metrics.emd import EMD_POINTS, emd_mm
from plop.recordings.recording import Recording

SHIFTS_MM = (0.0, 0.5, 2.0, 8.0)


def main(path: Path) -> None:
    """Measure and print one line per shift."""
    with Recording(path) as recording:
        views = [recording.view(name, 0) for name in recording.camera_names]
    parts = [view.camera for view in views], [view.depth_m for view in views], [view.object_mask for view in views]
    first, other = (back_project_all(*parts, seed=seed) for seed in (0, 1))
    sys.stdout.write("shift [mm]  true EMD [mm]  common [mm]  independent [mm]\n")
    for shift_mm in SHIFTS_MM:
        moves = np.where(first.points[:, :1] > 0, [shift_mm / 1000, 0, 0], 0)
        truth = shift_mm * float((first.points[:, 0] > 0).mean())
        common, independent = (
            emd_mm(*paired_samples(first, Cloud(first.points + moves, priority), EMD_POINTS))
            for priority in (first.priority, other.priority)
        )
        sys.stdout.write(f"{shift_mm:10.1f}  {truth:13.2f}  {common:11.2f}  {independent:16.2f}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
