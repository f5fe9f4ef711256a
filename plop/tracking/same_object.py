"""Check that a model and recordings are of the same object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from plop.dynamics.i2n.model_io import read_facts
from plop.errors import PlopError
from plop.geometry.meshes.extent import box_edges_m
from plop.models import innermost
from plop.tracking.episode import Episode

SIZE_SHARE = 0.3
"""Largest difference in size between the object of the model and that of the recordings."""


def size_m(episodes: Sequence[Episode]) -> np.ndarray:
    """Return the median size of the objects at the first frame, see `box_edges_m`, [3] [m]."""
    return np.asarray(np.median([box_edges_m(e.vertices, e.faces) for e in episodes], axis=0))


def check_same_object(
    model: Path, environment: str, episodes: Sequence[Episode], *, fix: str, about: str | None = None
) -> None:
    """Reject a model of another object, by its environment and, if known to the model, by its size.

    Args:
        model: The model's folder.
        environment: Environment of the recordings.
        episodes: Their episodes.
        fix: What the user can do.
        about: Environment of the model, if its files do not state it.

    Raises:
        PlopError: Environment or size differ.
    """
    facts = read_facts(innermost(model)).get("training", {})
    about = facts.get("environment") or about
    if about and about != environment:
        raise PlopError(
            "Model and recordings are of different objects.",
            where=model,
            expected=str(about),
            found=environment,
            fix=fix,
        )
    known = facts.get("size_m")
    if known is None or not episodes:
        return
    size = size_m(episodes)
    if (np.abs(size / np.asarray(known, float) - 1) > SIZE_SHARE).any():
        raise PlopError(
            "Model and recordings are of objects of different size.",
            where=model,
            expected=_text(np.asarray(known, float)),
            found=_text(size),
            fix=fix,
        )


def _text(size: np.ndarray) -> str:
    return " x ".join(f"{1000 * edge:.0f}" for edge in size) + " mm"
