"""Score the band of rollouts on the tracked points of test episodes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.layouts import Rollouts, ScoreFiles
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.pipeline.stage import Inputs
from plop.recordings.set import RecordingSet
from plop.uncertainty.band import Band
from plop.uncertainty.errors import point_errors
from plop.uncertainty.scores import BandScores, score_bands
from stages.common_inputs import measured_episodes
from stages.eval.plot import plot_bands

GOAL = (0.87, 0.93)
"""Coverage of a band that keeps its promise of 90 %."""


def has_band(config: Any, inputs: Inputs) -> bool:
    """Return whether the rollouts have a band."""
    return "rollouts" in inputs and (inputs["rollouts"].path / Band.FILE).is_file()


def score_bands_of(
    inputs: Inputs, recordings: RecordingSet, names: Sequence[str], seed: int, folder: Path
) -> tuple[dict[str, Any], list[str]]:
    """Write bands.json, a picture, and the errors of each test episode.

    Returns:
        Figures and warnings for the summary.

    Raises:
        PlopError: There are no tracks, or they are of other recordings.
    """
    tests = [name for name in names if name in recordings.test]
    if not tests:
        return {}, ["The band is not scored: no test episode was rolled out."]
    band = Band.load(inputs["rollouts"].path)
    episodes, left_out = measured_episodes(inputs, recordings, tests)
    errors = []
    for episode in episodes:
        with Trajectory(Rollouts(inputs["rollouts"].path).episode(episode.name).states) as states:
            errors.append(point_errors(episode, _frames(states)))
        errors[-1].write(ScoreFiles(folder).band_errors(episode.name))
    scores = score_bands(errors, band, left_out, seed=seed)
    scores.write(folder)
    plot_bands(ScoreFiles(folder).bands, errors, scores)
    return _told(scores)


def _frames(states: Trajectory) -> Iterator[tuple[Gaussians, np.ndarray]]:
    for frame in states.frames("states"):
        yield states.read("states", frame), states.extra("states", frame, "spread_m").numpy()


def _told(scores: BandScores) -> tuple[dict[str, Any], list[str]]:
    figures: dict[str, Any] = {"band_factor": round(scores.band.factor, 3)}
    for method in ("ensemble", "widened"):
        for key, found in scores.methods[method].items():
            figures[f"{method}_{key}"] = round(found.mean, 3)
    warnings = [f"The band is not scored in {name}: {why}" for name, why in scores.left_out.items()]
    coverage = scores.methods["widened"]["coverage"]
    if not GOAL[0] <= coverage.mean <= GOAL[1]:
        warnings.append(
            f"The 90 % band holds {coverage.mean:.0%} of the measured points of {coverage.n} test episode(s); "
            f"it was calibrated on {len(scores.band.validation)}"
        )
    return figures, warnings
