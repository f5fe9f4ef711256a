"""Result of an evaluation: scores.json of `plop eval`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from plop.artifacts.result_file import ResultFile
from plop.statistics.bootstrap import Interval

PARTS = {
    "episode": "mean over the predicted frames (all but frame 0, which is given)",
    "end": "last frame",
    "start": "frame 0, which is given: the floor that fit and rendering set",
}
"""The parts of an episode that are reported."""
BASELINES = {
    "persistence": "frame 0's Gaussians, nothing moves but the tool",
    "rigid": "frame 0's Gaussians moved as one body, fitted to the measured cloud of each frame: an oracle",
}
RIVALS = {
    "engine": "the fitted engine alone, from frame 0",
    "replay": "the tracked motion of the training episode whose tool moved most alike, repeated",
    "velocity": "the motion of the last observed frame continues; sees the first frames",
    "residual": "the engine, shifted by its error in the last observed frame; sees the first frames",
}
"""Scored on request: `plop eval --engine`, `--tracks`, `--observed-frames`."""


@dataclass(frozen=True, kw_only=True)
class Scores(ResultFile):
    """Scores of a model and of two baselines, by method, part of the episode and score."""

    FILE: ClassVar[str] = "scores.json"
    COMMAND: ClassVar[str] = "eval"
    SCHEMA: ClassVar[int] = 1

    environment: str
    method: str
    """The model's name among the methods."""
    seed: int
    conventions: Mapping[str, str]
    """Score -> what it means."""
    parts: Mapping[str, str] = field(default_factory=lambda: PARTS)
    baselines: Mapping[str, str] = field(default_factory=lambda: BASELINES)
    unavailable: Mapping[str, str]
    """Score -> why there is none."""
    notes: tuple[str, ...]
    methods: Mapping[str, Mapping[str, Mapping[str, Interval | None]]]
    """Method -> part -> score -> mean over episodes."""
    better_than_persistence_percent: Mapping[str, Mapping[str, float]]
    """Part -> score -> how far the model's error is below persistence's."""
    episodes: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float | None]]]]
    """Episode -> method -> part -> score."""
