"""The missing-physics benchmark with a learned base: `python -m benchmarks.physics_learned --minutes 60`.

One manipulation, cut and push, as learned models are trained. I2N learns from the followed points of episodes
without anything hidden (no cameras, no rendering loss: the points are its particles); hidden effects, scene and the
engine that computes the responses are those of `benchmarks.physics_points`. It goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.newest import newest_rows
from benchmarks.physics_plan import PLAN
from benchmarks.physics_points import SCENE, Setting, fitted_engine, reference, run_missing, simulated
from benchmarks.physics_tables import summary
from plop.diagnosis.table import Measured
from plop.dynamics.episodes import Actions
from plop.dynamics.interface import at_rest
from plop.dynamics.model import PlopModel
from plop.dynamics.model_io import load_model
from plop.dynamics.physical_losses import Neighbourhood
from plop.dynamics.resampling import ResamplingConfig
from plop.dynamics.rollout import predict
from plop.dynamics.sides import advance_sides
from plop.gaussians.state import Gaussians
from plop.geometry.tool import ToolGeometry
from plop.pipeline.execute import versions
from plop.pipeline.stage import Output
from plop.tracking.episode import Episode
from stages.train.settings import TrainConfig
from stages.train.stage import train_on
from stages.train.tracks import Track

TRAINED, TRAINED_SEED = 24, 3000
"""Episodes that I2N learns from; the reference's are others."""
SETS = ("single", "null", "base")
SCENE_CUT = replace(SCENE, motions=("cut-push",))
_WIDTH_M, _OPACITY = 0.003, 0.9
"""Width and opacity of the Gaussian that stands for a followed point."""
TRAINING = TrainConfig(
    track_steps=1500, image_steps=0, horizon=8, resampling=ResamplingConfig(enabled=False), device="cpu"
)


def main() -> None:
    """Train, run what is left of the plan, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60, help="Stop starting runs after so many minutes.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics-learned"), help="Where runs are.")
    parser.add_argument(
        "--engine-work",
        type=Path,
        default=Path("artifacts/.bench-physics"),
        help="Folder of `benchmarks.physics_points`, whose engine is taken.",
    )
    parser.add_argument("--out", type=Path, default=Path("docs/results/physics-learned.json"))
    options = parser.parse_args()
    for folder in (options.work, options.engine_work):
        folder.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + 60 * options.minutes
    engine, model = fitted_engine(options.engine_work, options.jobs), trained(options.work, options.jobs)

    def measured(episodes: list[Episode]) -> Measured:
        return Measured(episodes, {e.name: [predicted(model, e)] for e in episodes})

    known = measured(reference(options.jobs, SCENE_CUT))
    setting = Setting(known, engine, measured, SCENE_CUT)
    plans = [plan for plan in PLAN if plan.set in SETS]
    run_missing(plans, setting, options.work, options.jobs, deadline)
    rows = newest_rows([plan.name for plan in plans], options.work, {})
    options.out.write_text(json.dumps(facts_of(rows, known), indent=1))


def facts_of(rows: list[dict[str, Any]], reference: Measured) -> dict[str, Any]:
    """Rates, runs, and how far the learned base is off in motions that it has not seen."""
    assert reference.predictions is not None
    errors = [1000 * rms_m(episode, reference.predictions[episode.name][0]) for episode in reference.episodes]
    kept = (
        "name",
        "set",
        "seed",
        "hidden",
        "rms_mm",
        "snr",
        "verdict",
        "named",
        "ranks",
        "error",
        "floor",
        "left",
        "gains",
        "text",
    )
    return {
        "command": "python -m benchmarks.physics_learned",
        "versions": versions(),
        "seeds": sorted({row["seed"] for row in rows}),
        "base_rms_mm": errors,
        "sets": summary(rows),
        "runs": [{key: row.get(key) for key in kept} for row in rows],
    }


def rms_m(episode: Episode, predicted_points: np.ndarray) -> float:
    """RMS error of the patches' motion [m]."""
    error = episode.pooled(predicted_points - predicted_points[:1]) - episode.motion
    return float(np.sqrt((error**2).sum(-1).mean()))


def trained(work: Path, jobs: int) -> PlopModel:
    """Train I2N, once."""

    def tracks() -> list[Track]:
        return [track_of(episode) for episode in simulated(SCENE_CUT, TRAINED_SEED, TRAINED, [], jobs)]

    return train_once(work / "model", tracks, TRAINING, SCENE.name, threads=1 if jobs == 1 else 2)


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


if __name__ == "__main__":
    main()
