"""Table I: recordings in, scored predictions out, I2N and its peers by the same commands.

The recordings are made by `plop simulate` from a scene that comes with plop, or are DiSECt's, read from a folder. Every
model learns from the same tracks with the same objective, windows and seeds. Equal compute: I2N trains for a given
number of steps, a peer for as many as take the same CPU time; the cost of a step is measured with the models in turn.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from statistics import median
from typing import get_args

import torch

from benchmarks.workspace import Typed
from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import ScoreFiles
from plop.artifacts.store import Artifact
from plop.dynamics.learned import DynamicsName, parameter_count, untrained
from plop.recordings.set import RecordingSet
from plop.render.losses import RenderWeights
from stages.train.form import model_config
from stages.train.objective import TrainingStep
from stages.train.settings import TrainConfig
from stages.train.training_set import TrainingSet
from stages.train.windows import draw_windows

NAMES: tuple[DynamicsName, ...] = get_args(DynamicsName)
RIVALS = ("persistence", "rigid", "engine", "replay", "velocity", "residual")
SMALL = """
[simulate]
episodes = 6
test = ["*_004", "*_005"]
cameras.size = 80
cameras.count = 4
cameras.texture = "dough"
cameras.depth_noise_m = 0.0005

[ingest.disect]
episodes = "*_part_*"
cameras.size = 80
cameras.count = 4

[fit-init]
steps = 300
count = 1000
tool_count = 600
virtual_views = 0
render.depth_unit_m = 0.02
render.mask = 0.3

[filter.update]
iterations = 12

[identify]
iterations = 3
spacing_m = 0.008
split = "train"

[train]
image_steps = 0
horizon = 4
validate_every = 50
update.iterations = 12

[eval]
emd_every = 10
"""
"""Settings of a run of minutes."""


@dataclass(frozen=True)
class PipelinePlan:
    """One environment."""

    environment: str
    """A scene of plop, or an environment of DiSECt's recordings."""
    data: Path | None
    """Folder of DiSECt's recordings; None simulates the scene."""
    seeds: tuple[int, ...]
    steps: int
    """Steps of I2N."""
    small: bool
    """Small images and few Gaussians."""
    engine: bool
    """Fit the engine, too, and score the rivals that need it."""


def _profile(name: str) -> str:
    """Return a profile of plop as a settings file: without the keys of the whole run, which stand before the tables."""
    text = (files("plop.pipeline") / "profiles" / f"{name}.toml").read_text(encoding="utf-8")
    return text[text.index("\n[") + 1 :]


class Pipeline(Typed):
    """One environment's workspace; finished stages are skipped, so that a stopped run goes on."""

    def __init__(self, work: Path, plan: PipelinePlan) -> None:
        settings = SMALL if plan.small else _profile("demo" if plan.data is None else "cpu")
        super().__init__(work / f"{plan.environment}{'-small' if plan.small else ''}-{plan.steps}", settings)
        self.plan = plan

    def carry_out(self) -> None:
        """Make recordings, train every model on every seed, and score it."""
        plan = self.plan
        if plan.data is None:
            self.plop("simulate", f"{plan.environment}.toml", "--name", "recordings")
        else:
            self.plop("ingest", "disect", str(plan.data), "--environment", plan.environment, "--name", "recordings")
        self.plop("fuse", "--recordings", "recordings", "--name", "clouds")
        self.plop("fit-init", "--recordings", "recordings", "--name", "init")
        if plan.engine:
            self.plop("identify", "--recordings", "recordings", "--name", "engine")
            name = f"rollout-engine-{plan.seeds[0]}"
            self.plop("rollout", "--recordings", "recordings", "--model", "engine", "--name", name)
        for seed in plan.seeds:
            self._train("i2n", seed, plan.steps)
            for name in NAMES:
                self._train(name, seed, self.steps_of(name))
                self._score(name, seed)

    def steps_of(self, name: DynamicsName) -> int:
        """Return how many steps a model trains, for the CPU time of I2N's."""
        costs = self.costs()
        return max(1, round(self.plan.steps * costs["i2n"]["step_ms"] / costs[name]["step_ms"]))

    def costs(self) -> dict[str, dict[str, float]]:
        """Measure once what a training step costs, and count parameters."""
        path = self.workspace / "costs.json"
        if not path.is_file():
            write_json(
                path, measured_costs(self.store.find(f"i2n-{self.plan.seeds[0]}"), self.store.find("recordings"))
            )
        found: dict[str, dict[str, float]] = json.loads(path.read_text())
        return found

    def reports(self, name: str) -> list[Path]:
        """Return the scores of a model or a rival, one file a seed; a rival's are in the first of I2N."""
        seeds = self.plan.seeds if name in NAMES else self.plan.seeds[:1]
        label = name if name in NAMES else "i2n"
        return [ScoreFiles(self.store.find(f"eval-{label}-{seed}").path).report for seed in seeds]

    def _train(self, name: DynamicsName, seed: int, steps: int) -> None:
        words = ["--dynamics", name, "--seed", str(seed), "--track-steps", str(steps), "--image-steps", "0"]
        self.plop("train", "--recordings", "recordings", *words, "--name", f"{name}-{seed}")

    def _score(self, name: DynamicsName, seed: int) -> None:
        model = f"{name}-{seed}"
        self.plop("rollout", "--recordings", "recordings", "--model", model, "--name", f"rollout-{model}")
        more = []
        if model == f"i2n-{self.plan.seeds[0]}":  # once: the rivals do not depend on the model
            more = ["--tracks", model, "--observed-frames", "1", *(["--engine", "engine"] if self.plan.engine else [])]
        words = ["--rollouts", f"rollout-{model}", "--method", name, *more, "--name", f"eval-{model}"]
        self.plop("eval", "--recordings", "recordings", *words)


def measured_costs(trained: Artifact, recordings: Artifact, rounds: int = 7) -> dict[str, dict[str, float]]:
    """Measure the CPU time of a training step of every model in turn, on the tracks of a trained one.

    Returns:
        Model -> {"step_ms": median, "parameters"}.
    """
    known = RecordingSet.load(recordings.path)
    tracks = TrainingSet(known, trained.path, torch.device("cpu"), list(known.train), [])
    config = TrainConfig()
    every = [tracks.track(i) for i in range(len(tracks))]
    motions = [track.means.diff(dim=0).norm(dim=-1).mean(dim=1).double().numpy() for track in every]
    weights = replace(config.weights, image=0.0)
    steps = {name: TrainingStep(untrained(model_config(replace(config, dynamics=name), every))) for name in NAMES}
    times: dict[str, list[float]] = {name: [] for name in NAMES}
    for k in range(rounds):
        windows = draw_windows(motions, config.batch, 2, seed=0, step=k, mirror=True)
        for name, step in steps.items():
            began = time.process_time()
            step(windows, [every[w.episode] for w in windows], weights, RenderWeights(), config.noise_m)[0].backward()
            times[name].append(1e3 * (time.process_time() - began))
    return {
        name: {"step_ms": round(median(times[name][1:]), 1), "parameters": parameter_count(step.model)}
        for name, step in steps.items()
    }
