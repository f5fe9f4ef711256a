"""Preconditions for comparing a prediction with recordings."""

from __future__ import annotations

import h5py

from plop.artifacts.lineage import made_from
from plop.comparison.result import CONVENTIONS
from plop.errors import PlopError
from plop.pipeline.stage import Inputs
from plop.recordings.set import RecordingSet

SAID = {key: CONVENTIONS[key] for key in ("units", "world_frame")}
"""Conventions that every recording must declare."""


def check_conventions(inputs: Inputs, recordings: RecordingSet) -> None:
    """Reject recordings in other units or frames, and fits or tracks of other recordings.

    Raises:
        PlopError: Something differs; names it.
    """
    for name in recordings.names:
        with h5py.File(recordings.path(name), "r") as file:
            for key, wanted in SAID.items():
                found = str(file.attrs.get(key, "nothing"))
                if found != wanted:
                    raise PlopError(
                        "A recording has another convention.",
                        where=f"{recordings.path(name)}: {key}",
                        expected=wanted,
                        found=found,
                        fix="Convert it with `plop ingest`.",
                    )
    own = inputs["recordings"].manifest
    for part in ("init", "tracks"):
        made = inputs[part].manifest
        source = made.inputs.get("recordings") if made is not None else None
        if made is None or own is None or source is None:
            continue  # called from Python with plain folders: the contents are checked when they are read
        if not made_from(made, "recordings", own):
            raise PlopError(
                "Results of different recordings cannot be compared.",
                where=f"compare.{part}",
                expected=f"made from {own.address}",
                found=f"made from {source['stage']}@{source['fingerprint'][:8]}",
                fix="Cameras and clocks may differ between the two: run `plop fit-init` and `plop filter` "
                "on the recordings that you compare with.",
            )
