"""Score material points against a simulator's ground truth, if available."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import numpy as np

from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.geometry.rigid import transform_points
from plop.metrics.frame import Scores
from plop.metrics.node_error import ancestor_means, move_nodes, rms_mm
from plop.recordings.truth import Truth


class MaterialPoints:
    """Move true nodes with the prediction and both baselines; does nothing without ground truth.

    Args:
        recording: The episode's file.
        states: The rollout's trajectory; the prediction has no score without it.
        use: False disables the score.
    """

    def __init__(self, recording: Path, states: Path, *, use: bool) -> None:
        self._scores: dict[tuple[int, str], float] = {}
        self._files = ExitStack()
        self._truth: Truth | None = None
        self._states: Trajectory | None = None
        if use and Truth.is_in(recording):
            truth = self._files.enter_context(Truth(recording))
            self._truth = truth if truth.has_nodes else None
            self._states = self._files.enter_context(Trajectory(states)) if states.is_file() else None
        if self._truth is not None:
            self._start = self._truth.nodes_m(0)
        if self._states is not None:
            self._ancestors = ancestor_means(*_arrays(self._states.read("states", 0)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def add(self, frame: int, method: str, rigid_pose: np.ndarray, rivals: Mapping[str, Gaussians]) -> None:
        """Score one frame.

        Args:
            frame: Index of the frame.
            method: Name of the prediction in `states`.
            rigid_pose: Motion of the rigid baseline since frame 0, shape [4, 4].
            rivals: Gaussians of further predictions.
        """
        if self._truth is None:
            return
        true = self._truth.nodes_m(frame)
        self._scores[frame, "persistence"] = rms_mm(self._start, true)
        self._scores[frame, "rigid"] = rms_mm(transform_points(rigid_pose, self._start), true)
        if self._states is None:
            return
        known, before = self._ancestors
        for name, gaussians in {method: self._states.read("states", frame), **rivals}.items():
            names, after = ancestor_means(*_arrays(gaussians))
            kept = np.isin(names, known)
            start = before[np.searchsorted(known, names[kept])]
            self._scores[frame, name] = rms_mm(move_nodes(self._start, start, after[kept]), true)

    def score(self, frame: int, method: str) -> Scores:
        """Return {"truth_rms_mm": ...} of one frame, or nothing without ground truth."""
        return {"truth_rms_mm": self._scores.get((frame, method))} if self._truth is not None else {}


def _arrays(gaussians: Gaussians) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return gaussians.ids.numpy(), gaussians.means.double().numpy(), gaussians.opacities.numpy()
