"""Cheap rivals of a model, on request: what a prediction must beat to be worth its effort.

- **engine** (input `engine`): the fitted physics model alone.
- **replay** (input `tracks`): the training episode whose tool moved most alike, its tracked motion repeated.
- **velocity** (`observed_frames` > 0): the filter follows the first frames; then the last motion goes on.
- **residual** (both): the filter follows the first frames; then the engine goes on, shifted by what it was off then.

The last two see the measured images of the first frames, which a prediction from frame 0 does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import torch

from plop.artifacts.layouts import Model
from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.episodes import Actions
from plop.dynamics.filter.particle_filter import UpdateConfig, run_filter
from plop.dynamics.initial_surface import initial_surface
from plop.dynamics.interface import DynamicsModel, ParticleState, at_rest
from plop.dynamics.rollout import predict
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.geometry.clouds.neighbours import nearest_index
from plop.models import engine_of, load_model, trained_on
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet


@dataclass(frozen=True)
class Rivals:
    """Which rivals are scored."""

    recordings: RecordingSet
    engine: Path | None
    """Folder of an engine."""
    tracks: Path | None
    """Folder of a learned model with the tracks of its training episodes."""
    observed_frames: int

    def check(self) -> None:
        """Reject inputs that are of another kind.

        Raises:
            PlopError: The engine is a learned model, or the tracks are not those of these recordings.
        """
        if self.engine is not None and engine_of(self.engine) is None:
            raise PlopError(
                "This is not an engine.",
                where=self.engine,
                expected="a model of `plop identify`",
                found="a learned model",
                fix="Run `plop identify --split train` on these recordings.",
            )
        if self.tracks is not None and not self._training_episodes():
            raise PlopError(
                "There is no training motion to replay.",
                where=Model(self.tracks).tracks.folder,
                expected=f"tracks of {', '.join(self.recordings.train) or 'training episodes'}",
                found=", ".join(sorted(trained_on(self.tracks))) or "none",
                fix="Name a model of `plop train` on these recordings.",
            )

    def roll_out(self, recording: Recording, start: Gaussians) -> dict[str, list[Gaussians]]:
        """Predict an episode with every rival.

        Args:
            recording: The episode.
            start: Gaussians at frame 0.

        Returns:
            Rival -> the Gaussians of every frame.
        """
        found: dict[str, list[Gaussians]] = {}
        engine = None if self.engine is None else self._predicted(load_model(self.engine), recording, start)
        if engine is not None:
            found["engine"] = engine
        if self.tracks is not None:
            found["replay"] = self._replayed(recording, start)
        if self.observed_frames > 0:
            followed = _followed(recording, start, self.observed_frames)
            gaussians = [state.gaussians for state in followed]
            going_on = self._predicted(ConstantVelocity(keep=1.0), recording, start, followed)
            found["velocity"] = gaussians + going_on[len(gaussians) :]
            if engine is not None:
                off = gaussians[-1].means - engine[len(gaussians) - 1].means
                rest = [each.with_(means=each.means + off) for each in engine[len(gaussians) :]]
                found["residual"] = gaussians + rest
        return found

    def _predicted(
        self, model: DynamicsModel, recording: Recording, start: Gaussians, known: list[ParticleState] | None = None
    ) -> list[Gaussians]:
        """Step a model from frame 0, or from the last of the known states on."""
        known = known or [at_rest(start, initial_surface(recording, start))]
        steps = Actions.of(recording).steps()[len(known) - 1 :]
        states = predict(model, known[-1], steps, recording.name, 0)
        return [state.gaussians for state in known[:-1]] + [state.gaussians for state, _ in states]

    def _training_episodes(self) -> list[str]:
        assert self.tracks is not None
        return [name for name in self.recordings.train if name in trained_on(self.tracks)]

    def _replayed(self, recording: Recording, start: Gaussians) -> list[Gaussians]:
        """Move each Gaussian as the nearest one of the most similar training episode moved."""
        assert self.tracks is not None
        middle = start.means.mean(0)
        poses, best, least = recording.world_from_tool, None, np.inf
        for name in self._training_episodes():
            with self.recordings.open(name) as other, Trajectory(Model(self.tracks).tracks.states(name)) as track:
                first = track.read("updated", 0)
                shift = (middle - first.means.mean(0)) * torch.tensor([1.0, 1.0, 0.0])
                apart = _tools_apart_m(recording.tool_mesh.vertices, poses, other.world_from_tool, shift.numpy())
                if apart < least and other.name != recording.name:
                    best, least = (name, first, shift), apart
        if best is None:
            return [start] * len(recording)
        name, first, shift = best
        index = nearest_index(start.means - shift, first.means)
        with Trajectory(Model(self.tracks).tracks.states(name)) as track:
            frames = track.frames("updated")
            moved = [track.read("updated", frames[min(t, len(frames) - 1)]) for t in range(len(recording))]
        return [start.with_(means=start.means + (each.means - first.means)[index]) for each in moved]


def _tools_apart_m(vertices: np.ndarray, poses: np.ndarray, others: np.ndarray, shift: np.ndarray) -> float:
    """Mean distance of the tool's vertices between two motions, the other one shifted; each rests at its end [m]."""
    frames = max(len(poses), len(others))
    one, other = (each[np.minimum(np.arange(frames), len(each) - 1)] for each in (poses, others))
    turned = vertices @ np.swapaxes(one[:, :3, :3] - other[:, :3, :3], 1, 2)
    apart = turned + (one[:, :3, 3] - other[:, :3, 3] - shift)[:, None]
    return float(np.linalg.norm(apart, axis=2).mean())


def _followed(recording: Recording, start: Gaussians, frames: int) -> list[ParticleState]:
    """Track the object through the first frames on its images; the state of frame 0 comes first."""
    steps = islice(run_filter(ConstantVelocity(), recording, start, UpdateConfig(), score=False), frames)
    return [at_rest(start), *(step.updated for step in steps)]
