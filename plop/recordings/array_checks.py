"""Expected shape and type of a stored array."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import h5py
import numpy as np


@dataclass(frozen=True)
class Part:
    """Expected shape and type of one array."""

    shape: tuple[int | None, ...]
    """Lengths; None is any length."""
    kinds: str = "buif"
    """Kinds of numbers, as in `numpy.dtype.kind`."""
    advice: Mapping[tuple[int | None, ...], str] = field(default_factory=dict)
    """Shapes of known mistakes, and what to do about each."""

    def misfit(self, array: np.ndarray | h5py.Dataset) -> tuple[str, str] | None:
        """Return the expected and the actual properties; None when they match. The data of a dataset are not read."""
        have = array.shape or ()
        if _alike(have, self.shape) and (array.dtype.kind in self.kinds or 0 in have):
            return None
        numbers = "numbers" if "f" in self.kinds else "whole numbers"
        lengths = " x ".join("n" if want is None else str(want) for want in self.shape)
        return f"{numbers}, {lengths}", f"{array.dtype}, {' x '.join(map(str, have)) or 'a single value'}"

    def fix(self, array: np.ndarray | h5py.Dataset) -> str | None:
        """Return what to do about an array of another shape; None for an unknown mistake."""
        return next((text for shape, text in self.advice.items() if _alike(array.shape or (), shape)), None)


def _alike(have: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(have) == len(wanted) and all(want in (None, length) for want, length in zip(wanted, have, strict=True))
