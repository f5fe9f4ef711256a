"""What must be alike before a prediction may be compared with recordings."""

from __future__ import annotations

import h5py
import numpy as np

from plop.diagnosis.episode import Episode
from plop.dynamics.model_io import read_facts
from plop.errors import PlopError
from plop.models import innermost
from plop.recordings.set import RecordingSet
from stages.contract import Inputs

CONVENTIONS = {"units": "m, s", "world_frame": "right-handed, z up"}
"""What every recording must say of itself."""
SIZE_SHARE = 0.3
"""Largest difference in size between the object of the model and that of the recordings."""


def check_conventions(inputs: Inputs, recordings: RecordingSet) -> None:
    """Refuse recordings in other units or frames, and fits or tracks of other recordings.

    Raises:
        PlopError: Something is unlike; names what.
    """
    for name in recordings.names:
        with h5py.File(recordings.path(name), "r") as file:
            for key, wanted in CONVENTIONS.items():
                found = str(file.attrs.get(key, "nothing"))
                if found != wanted:
                    raise PlopError("A recording follows another convention.", where=f"{recordings.path(name)}: {key}",
                                    expected=wanted, found=found, fix="Convert it: `plop ingest`.")  # fmt: skip
    own = inputs["recordings"].manifest
    for part in ("init", "tracks"):
        made = inputs[part].manifest
        source = made.inputs.get("recordings") if made is not None else None
        if own is None or source is None or "fingerprint" not in source:
            continue  # called from Python with bare folders: the contents are checked where they are read
        if source["fingerprint"] != own.fingerprint:
            raise PlopError("Results of different recordings are not compared.", where=f"compare.{part}",
                            expected=f"made from {own.address}",
                            found=f"made from {source['stage']}@{source['fingerprint'][:8]}",
                            fix="Cameras and clocks may differ between the two: run `plop fit-init` and `plop filter` "
                                "on the recordings that you compare with.")  # fmt: skip


def check_same_object(inputs: Inputs, recordings: RecordingSet, episodes: list[Episode]) -> None:
    """Refuse a model of another object, by its environment and, where the model knows it, by its size.

    Raises:
        PlopError: Environment or size differ.
    """
    model = inputs["model"].path
    facts = read_facts(innermost(model)).get("training", {})
    manifest = inputs["model"].manifest
    about = facts.get("environment") or (manifest.environment if manifest is not None else None)
    fix = "Choose a model of this object, or set compare.other_object."
    if about and about != recordings.environment:
        raise PlopError("Model and recordings are of different objects.", where=model, expected=str(about),
                        found=recordings.environment, fix=fix)  # fmt: skip
    known = facts.get("size_m")
    if known is None:
        return
    size = size_m(episodes)
    if (np.abs(size / np.asarray(known, float) - 1) > SIZE_SHARE).any():
        raise PlopError("Model and recordings are of objects of different size.", where=model,
                        expected=_text(np.asarray(known, float)), found=_text(size), fix=fix)  # fmt: skip


def size_m(episodes: list[Episode]) -> np.ndarray:
    """Give the median extent of the objects at the first frame, longest first, [3] [m]."""
    extents = [np.sort(np.ptp(e.vertices, axis=0))[::-1] for e in episodes]
    return np.asarray(np.median(extents, axis=0))


def _text(size: np.ndarray) -> str:
    return " x ".join(f"{1000 * edge:.0f}" for edge in size) + " mm"
