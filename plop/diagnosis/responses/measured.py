"""Read what a diagnosis or a plan compares: tracked episodes, the base's prediction of each, and the engine."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from plop.artifacts.layouts import Fits
from plop.comparison.bases import predictions_of
from plop.diagnosis.responses.table import Measured
from plop.dynamics.i2n.model_io import read_facts
from plop.errors import PlopError
from plop.models import engine_of
from plop.physics.adapters.filled import EngineBase
from plop.recordings.set import RecordingSet
from plop.tracking.episode import Episode
from plop.tracking.sets import tracked_episodes

LEAST_UNSEEN = 3
"""Reference episodes that tell how far a learned model is off where nothing is missing."""


def unseen(names: list[str], trained: frozenset[str]) -> tuple[list[str], list[str]]:
    """Choose the reference episodes on which no model was trained, or all with a warning where these are too few.

    Where it has been trained it errs less than anywhere else, so that any other recording would seem to miss something.

    Args:
        names: The reference episodes.
        trained: Those that whatever predicts them was trained on: a fold that has not seen an episode predicts it.
    """
    seen = trained & set(names)
    unseen = [name for name in names if name not in seen]
    if not seen or len(unseen) >= LEAST_UNSEEN:
        return unseen, []
    return names, [
        f"the model was trained on {len(seen)} of {len(names)} reference episodes: its error there is too "
        "low, and small errors may pass for missing physics; train it with `--folds 2`, or give a "
        f"reference with {LEAST_UNSEEN} episodes or more that it has not seen"
    ]


def read_measured(
    recordings: RecordingSet,
    init: Path,
    tracks: Path,
    names: list[str],
    model: Path,
    seed: int,
    *,
    judges: Mapping[str, Path] = MappingProxyType({}),
) -> tuple[Measured, dict[str, str]]:
    """Read tracked episodes, with the prediction of a base that is not the bare engine.

    Args:
        recordings: The set.
        init: Payload of `fit-init`.
        tracks: Payload of `filter`.
        names: Names of the episodes.
        model: The base's folder.
        seed: Seed of the choice of points.
        judges: Models that predict an episode instead, by its name.

    Returns:
        The episodes, and those left out with the reason.
    """
    episodes, left_out = tracked_episodes(recordings, init, tracks, names, seed=seed)
    if read_facts(model)["kind"] == "engine":
        return Measured(episodes), left_out

    def predicted(episode: Episode) -> list[np.ndarray]:
        own = judges.get(episode.name, model)
        splat = Fits(init).episode(episode.name).object_splat
        return predictions_of(own, recordings.path(episode.name), splat, episode)

    return Measured(episodes, {e.name: predicted(e) for e in episodes}), left_out


def engine_beside(model: Path, given: Path | None) -> EngineBase:
    """Find the engine that computes the responses: the model's own, or the one given beside it.

    Raises:
        PlopError: A learned model without one.
    """
    engine = engine_of(model)
    if engine is None and given is not None:
        engine = engine_of(given)
    if engine is None:
        raise PlopError(
            "A learned model needs the engine beside it.",
            where=model,
            expected="an artifact of identify",
            found="none",
            fix="Run `plop identify` on the recordings it was trained on.",
        )
    return engine
