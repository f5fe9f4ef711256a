"""Arrays of a raw episode in an npz file, with checks of shapes and types."""

from __future__ import annotations

import zipfile
from collections.abc import Container, Mapping
from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.recordings.array_checks import Part


def read_npz(
    path: Path, parts: Mapping[str, Part], *, optional: Container[str] = (), may_be_empty: Container[str] = (), fix: str
) -> dict[str, np.ndarray]:
    """Read an npz file; keys that are not in `parts` are returned unchecked.

    Args:
        path: The file.
        parts: Expected arrays.
        optional: Arrays that may be absent.
        may_be_empty: Arrays that may have no elements.
        fix: What to do about an invalid file.

    Raises:
        PlopError: It is missing or damaged, or an array is missing or of another shape or kind; names file and key.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zipfile.LargeZipFile) as error:
        raise PlopError(
            "The episode's npz file is missing or damaged.",
            where=path,
            expected="a complete npz file",
            found=f"{type(error).__name__}: {error}",
            fix=fix,
        ) from error
    missing = [key for key in parts if key not in arrays and key not in optional]
    if missing:
        raise PlopError(
            "The episode's npz file is incomplete.",
            where=path,
            expected=", ".join(parts),
            found=f"no {', '.join(missing)}",
            fix=fix,
        )
    for key, part in parts.items():
        wrong = part.misfit(arrays[key]) if key in arrays else None
        if wrong is None and key in arrays and not arrays[key].size and key not in may_be_empty:
            wrong = ("at least one element", "none")
        if wrong is not None:
            raise PlopError(
                "An array of this episode has an unexpected shape or type.",
                where=f"{path}: {key}",
                expected=wrong[0],
                found=wrong[1],
                fix=part.fix(arrays[key]) or fix,
            )
    return arrays


def check_finite(values: np.ndarray, where: str) -> None:
    """Reject an array of a simulation that diverged.

    Raises:
        PlopError: It contains NaN or infinite values.
    """
    if not np.isfinite(values).all():
        raise PlopError(
            "This episode contains NaN or infinite values.",
            where=where,
            expected="finite numbers",
            found=f"{int((~np.isfinite(values)).sum())} others",
            fix="The simulation probably diverged: simulate it again or leave it out.",
        )
