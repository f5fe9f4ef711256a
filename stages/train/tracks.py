"""Tracks: the filter's states of every training episode, from which training starts its rollouts.

Made from the images only, by a filter that predicts with constant velocity. One file per episode,
tracks/<episode>.h5 (Trajectory, group "updated"), kept when training is interrupted and resumes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.episodes import Actions
from plop.dynamics.filter.particle_filter import UpdateConfig, run_filter
from plop.dynamics.interface import ParticleState, at_rest
from plop.dynamics.losses.physical import Neighbourhood
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory, TrajectoryWriter
from plop.recordings.recording import Recording
from plop.render.losses import RenderWeights


def track_episode(
    recording_path: Path,
    splat_path: Path,
    track_path: Path,
    config: UpdateConfig,
    on_frame: Callable[[int, int], None],
    device: torch.device | str = "cpu",
    *,
    weights: RenderWeights | None = None,
) -> dict[str, float]:
    """Track the object through one episode and write its track.

    Args:
        recording_path: The episode.
        splat_path: Gaussians at frame 0.
        track_path: File to write.
        config: The filter's update.
        on_frame: Called with (finished frames, all frames).
        device: Device of the filter.
        weights: Weights of the rendering loss; the defaults when absent.

    Returns:
        Mean over frames and cameras: {"depth_mm", "l1"} of the updated states.
    """
    initial = read_splat(splat_path).to(device)
    rows: list[dict[str, float]] = []
    with Recording.open(recording_path) as recording, TrajectoryWriter(track_path) as writer:
        append_state(writer, 0, at_rest(initial))
        for step in run_filter(ConstantVelocity(), recording, initial, config, weights=weights):
            append_state(writer, step.frame, step.updated)
            rows += step.innovation.values()
            on_frame(step.frame + 1, len(recording))
    count = max(len(rows), 1)
    return {
        "depth_mm": sum(row["updated_depth_mm"] for row in rows) / count,
        "l1": sum(row["updated_l1"] for row in rows) / count,
    }


def write_start(splat_path: Path, track_path: Path) -> None:
    """Write a track of the first frame alone: the fitted Gaussians, from which epochs on images start."""
    with TrajectoryWriter(track_path) as writer:
        append_state(writer, 0, at_rest(read_splat(splat_path)))


def append_state(writer: TrajectoryWriter, frame: int, state: ParticleState, **extra: Tensor | np.ndarray) -> None:
    """Add a state to a track's file, with further arrays of the frame."""
    writer.append(
        "updated",
        frame,
        state.gaussians,
        last_translation=state.last_translation,
        last_rotation=state.last_rotation,
        side=state.side,
        **extra,
    )


@dataclass(frozen=True)
class Track:
    """States of one episode, in memory: the filter's or the engine's; the same Gaussians in every frame.

    Where nothing was tracked, T is 1: the fitted Gaussians of the first frame.
    """

    name: str
    recording_path: Path | None
    """Path of the images; None for a simulated episode."""
    initial: Gaussians
    means: Tensor
    """Shape [T, N, 3] [m]."""
    quats: Tensor
    """Shape [T, N, 4]."""
    opacities: Tensor
    """Shape [T, N]."""
    translations: Tensor
    """Shape [T, N, 3] [m]."""
    rotations: Tensor
    """Shape [T, N, 3] [rad]."""
    sides: Tensor
    """Shape [T, N]."""
    actions: Actions
    pairs: Neighbourhood

    def __len__(self) -> int:
        return len(self.means)

    def state(self, frame: int) -> ParticleState:
        """The filter's state at one frame."""
        gaussians = self.initial.with_(
            means=self.means[frame], quats=self.quats[frame], opacities=self.opacities[frame]
        )
        return ParticleState(
            gaussians, self.translations[frame], self.rotations[frame], self.sides[frame], has_history=frame > 0
        )


@lru_cache(maxsize=32)
def load_track(
    name: str,
    recording_path: Path,
    track_path: Path,
    device: torch.device | str = "cpu",
    *,
    made_up: bool = False,
    unit_m: float = 1.0,
) -> Track:
    """Read a track to a device; a limited number of episodes is cached in memory.

    Args:
        name: The episode.
        recording_path: Its recording; for a simulated one the recording that it varies.
        track_path: The track's file.
        device: Device of its tensors.
        made_up: Whether the file has its own tool motion (see `stages.train.simulated_episodes`).
        unit_m: Unit of length of the weights between neighbours [m].
    """
    with Trajectory(track_path) as track, Recording.open(recording_path) as recording:
        frames = track.frames("updated")
        actions = Actions.of(recording, device)
        states = [track.read("updated", frame).to(device) for frame in frames]

        def extra(key: str) -> Tensor:
            return torch.stack([track.extra("updated", frame, key) for frame in frames]).to(device)

        if made_up:
            times = extra("time_s").cpu().numpy()
            actions = replace(actions, world_from_tool=extra("world_from_tool"), time_s=times)
        return Track(
            name=name,
            recording_path=None if made_up else recording_path,
            initial=states[0],
            means=torch.stack([s.means for s in states]),
            quats=torch.stack([s.quats for s in states]),
            opacities=torch.stack([s.opacities for s in states]),
            translations=extra("last_translation"),
            rotations=extra("last_rotation"),
            sides=extra("side"),
            actions=actions,
            pairs=Neighbourhood.of(states[0].means, unit_m=unit_m),
        )
