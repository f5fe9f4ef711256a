"""A learned base on followed points: I2N learns from points of episodes, which are its particles (no cameras).

What made docs/results/physics-learned.json ran with this at the commit that studies/README.md names.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from benchmarks.newest import newest_rows
from benchmarks.physics_plan import PLAN
from benchmarks.physics_points import SCENE, Setting, fitted_engine, reference, run_missing, simulated
from benchmarks.physics_tables import summary
from plop.diagnosis.table import Measured
from plop.dynamics.cut import advance_sides
from plop.dynamics.episodes import Actions
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.i2n.model_io import load_model
from plop.dynamics.interface import at_rest
from plop.dynamics.losses.physical import Neighbourhood
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.i2n.model_io import load_model
from plop.dynamics.losses.physical import Neighbourhood
from plop.dynamics.resampling import ResamplingConfig
from plop.dynamics.rollout import predict
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.tool import ToolGeometry
from plop.pipeline.execute import versions
from plop.geometry.meshes.tool import ToolGeometry
from plop.pipeline.stage import Output
from plop.tracking.episode import Episode
from stages.train.settings import TrainConfig
from stages.train.stage import train_on
from stages.train.tracks import Track

_WIDTH_M, _OPACITY = 0.003, 0.9
"""Width and opacity of the Gaussian that stands for a followed point."""
TRAINING = TrainConfig(
    track_steps=1500, image_steps=0, horizon=8, resampling=ResamplingConfig(enabled=False), device="cpu"
)


def rms_m(episode: Episode, predicted_points: np.ndarray) -> float:
    """RMS error of the patches' motion [m]."""
    error = episode.pooled(predicted_points - predicted_points[:1]) - episode.motion
    return float(np.sqrt((error**2).sum(-1).mean()))


def train_once(
    folder: Path, tracks: Callable[[], list[Track]], config: TrainConfig, environment: str, *, threads: int
) -> PlopModel:
    """Train on tracks and say how far it is, unless the folder holds the finished model."""
    if not (folder / "trained").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        made = tracks()

        def told(done: float, total: float, label: str = "", **figures: float) -> None:
            if done % 100 == 0:
                sys.stdout.write(f"{folder.name} {label} {done:g} of {total:g}: {figures}\n")
                sys.stdout.flush()

        torch.set_num_threads(threads)
        train_on(lambda k: made[k], len(made), config, Output(folder, told), about={"environment": environment})
        (folder / "trained").touch()
    return load_model(folder)


def gaussians_of(points: np.ndarray) -> Gaussians:
    """A small round Gaussian for each point, [M, 3] [m]."""
    means = torch.as_tensor(points, dtype=torch.float32)
    quats = torch.zeros(len(means), 4)
    quats[:, 0] = 1
    return Gaussians(
        means,
        quats,
        torch.full_like(means, _WIDTH_M),
        torch.full((len(means),), _OPACITY),
        torch.zeros(len(means), 1, 3),
        torch.arange(len(means)),
    )


def actions_of(episode: Episode) -> Actions:
    """The tool's motion as the model takes it."""
    tool = ToolGeometry.from_mesh(episode.tool.vertices, episode.tool.faces)
    poses = torch.as_tensor(episode.tool.world_from_tool, dtype=torch.float32)
    assert np.array_equal(episode.tool.times, episode.times)
    return Actions(tool, poses, episode.times, episode.table_z_m)


def track_of(episode: Episode) -> Track:
    """An episode's points as a track to train on; they do not turn."""
    means = torch.as_tensor(episode.points, dtype=torch.float32)
    first, actions = gaussians_of(episode.points[0]), actions_of(episode)
    still = torch.zeros_like(means)
    sides = [torch.zeros(means.shape[1])]
    for frame in range(1, len(means)):
        sides.append(advance_sides(sides[-1], means[frame], actions.step(frame - 1)))
    return Track(
        episode.name,
        Path(),
        first,
        means,
        first.quats.expand(len(means), -1, -1),
        first.opacities.expand(len(means), -1),
        torch.diff(means, dim=0, prepend=means[:1]),
        still,
        torch.stack(sides),
        actions,
        Neighbourhood.of(means[0]),
    )


def predicted(model: PlopModel, episode: Episode) -> np.ndarray:
    """Roll the model out from the first frame; the followed points, [T, M, 3] [m]."""
    start = at_rest(gaussians_of(episode.points[0]))
    states = predict(model, start, actions_of(episode).steps(), episode.name, seed=0)
    return np.stack([state.gaussians.means.double().numpy() for state, _ in states])
