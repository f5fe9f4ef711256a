"""Training data of a model: the tracks of recorded and of simulated episodes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch

from plop.artifacts.layouts import Model
from plop.recordings.set import RecordingSet
from stages.train.simulated_episodes import SimulatedEpisode
from stages.train.tracks import Track, load_track


@dataclass(frozen=True)
class TrainingSet:
    """Episodes by number, the recorded ones first; these are repeated so that simulated ones do not outweigh them."""

    recordings: RecordingSet
    folder: Path
    """Folder of tracks/ and made-up/."""
    device: torch.device
    recorded: list[str]
    made_up: list[SimulatedEpisode]
    unit_m: float = 1.0
    """Unit of length of the weights between neighbours [m]."""

    @cached_property
    def _order(self) -> list[str | SimulatedEpisode]:
        return [*self.recorded * max(1, round(len(self.made_up) / len(self.recorded))), *self.made_up]

    def __len__(self) -> int:
        """Number of episodes, repeated ones counted each time."""
        return len(self._order)

    def track(self, number: int) -> Track:
        """Read the track of an episode."""
        episode, files = self._order[number], Model(self.folder)
        if isinstance(episode, SimulatedEpisode):
            path, states = self.recordings.path(episode.recorded), files.made_up.states(episode.name)
            return load_track(episode.name, path, states, self.device, made_up=True, unit_m=self.unit_m)
        path, states = self.recordings.path(episode), files.tracks.states(episode)
        return load_track(episode, path, states, self.device, unit_m=self.unit_m)

    def without(self, names: Collection[str]) -> TrainingSet:
        """Leave out recorded episodes and the simulated ones derived from them."""
        return replace(
            self,
            recorded=[name for name in self.recorded if name not in names],
            made_up=[episode for episode in self.made_up if episode.recorded not in names],
        )
