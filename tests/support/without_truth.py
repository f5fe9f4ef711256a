"""A recording without ground truth, to show that a result does not depend on it."""

from __future__ import annotations

from pathlib import Path

import h5py


def write_without_truth(source: Path, target: Path) -> None:
    """Copy a recording, leaving out `/truth`."""
    with h5py.File(source, "r") as old, h5py.File(target, "w") as new:
        new.attrs.update(old.attrs)
        for key in old:
            if key != "truth":
                old.copy(key, new)
