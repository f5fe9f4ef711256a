"""Table IV: dynamics of bare particles, one rollout left out.

For each fold k: rollout k tests, rollout k + 1 chooses the checkpoint, the others train. Every network trains for the
same time (of the CPU; of the clock on a GPU) with the same objective: the open loop over a few frames, from two true
frames of which random noise has moved the second.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib import Parallel, delayed
from torch import Tensor, nn

from benchmarks.peers.particle_data import SAME_SCENE, ParticleRollout, read_rollouts
from benchmarks.peers.particle_models import MODELS, Moment, Units, open_loop, stepped
from benchmarks.peers.particle_rivals import rivals
from plop.artifacts.atomic_file import write_json
from stages.train.optimise import averaged_model


@dataclass(frozen=True)
class ParticlePlan:
    """What is trained and tested."""

    data: Path
    environment: str
    folds: tuple[int, ...]
    seeds: tuple[int, ...]
    seconds: float
    """CPU time of one training, without the validation rollouts; on a GPU its wall time."""
    device: str = "cpu"
    horizon: int = 8
    """Frames of an open loop in training; its gradient goes through all of them."""
    batch: int = 1
    """Open loops in a training step."""
    learning_rate: float = 1e-3
    noise: float = 0.5
    """Standard deviation of the noise on the earlier displacement, in units of its typical change."""
    validations: int = 5
    """Rollouts that choose the checkpoint, in equal shares of the time from the middle on."""


def errors(predicted: Tensor, true: Tensor) -> dict[str, float]:
    """Compare an open-loop rollout with the truth, from frame 2 on.

    Returns:
        Mean L2 and final L2 [mm], and the squared error per coordinate [10^-3 m^2], which the paper's Table IV is
        nearest to.
    """
    off = (predicted - true)[2:]
    lengths = off.norm(dim=-1)
    return {
        "mean_l2_mm": 1e3 * float(lengths.mean()),
        "final_l2_mm": 1e3 * float(lengths[-1].mean()),
        "mse_1e3_m2": 1e3 * float(off.square().mean()),
    }


def carry_out(plans: Iterable[ParticlePlan], work: Path, jobs: int = 1) -> None:
    """Train and test what is lacking; one row a file.

    Args:
        plans: One for each environment.
        work: Folder of the rows.
        jobs: Trainings at the same time; they share the device, all models alike.
    """
    wanted = []
    for plan in plans:
        rollouts = read_rollouts(plan.data, plan.environment)
        for fold in plan.folds:
            _untrained(plan, rollouts, fold, work)
        wanted += [(plan, fold, seed, name) for seed in plan.seeds for fold in plan.folds for name in MODELS]
    # All environments with one seed, then the next; the models take turns, so that each shares the device with all.
    wanted.sort(key=lambda each: each[2])
    lacking = [each for each in wanted if not _row(work, each[0], each[3], each[1], each[2]).is_file()]
    Parallel(n_jobs=jobs)(delayed(_training)(*each, work) for each in lacking)


def _untrained(plan: ParticlePlan, rollouts: list[ParticleRollout], fold: int, work: Path) -> None:
    test, _, training = split(rollouts, fold, SAME_SCENE.get(plan.environment, ()))
    if not _row(work, plan, "rigid", fold, 0).is_file():
        for name, predicted in rivals(test, training).items():
            found = errors(predicted, test.positions)
            write_json(_row(work, plan, name, fold, 0), {"errors": found, **_facts(plan, name, fold, 0, test)})


def _training(plan: ParticlePlan, fold: int, seed: int, name: str, work: Path) -> None:
    torch.set_num_threads(1)
    rollouts = [each.to(plan.device) for each in read_rollouts(plan.data, plan.environment)]
    test, chooser, training = split(rollouts, fold, SAME_SCENE.get(plan.environment, ()))
    found = trained(plan, name, training, chooser, test, seed)
    write_json(_row(work, plan, name, fold, seed), found | _facts(plan, name, fold, seed, test))


def split(
    rollouts: list[ParticleRollout], fold: int, same_scene: tuple[str, ...]
) -> tuple[ParticleRollout, ParticleRollout, list[ParticleRollout]]:
    """Leave one rollout out.

    Args:
        rollouts: All of them.
        fold: Number of the one that tests.
        same_scene: Names of rollouts of one scene, which stay on one side of the split: others of the test's are not
            used, nor are others of the choosing one's.

    Returns:
        The test rollout, the one that chooses the checkpoint (the next), and the others, which train.
    """
    number = fold % len(rollouts)
    test, kept = rollouts[number], [*rollouts[number + 1 :], *rollouts[:number]]
    if test.name in same_scene:
        kept = [each for each in kept if each.name not in same_scene]
    chooser, *training = kept
    if chooser.name in same_scene:
        training = [each for each in training if each.name not in same_scene]
    return test, chooser, training


def _row(work: Path, plan: ParticlePlan, name: str, fold: int, seed: int) -> Path:
    folder = work / "rows"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{plan.environment}-{plan.device}-{plan.seconds:g}s-{plan.horizon}-{name}-{fold}-{seed}.json"


def _facts(plan: ParticlePlan, name: str, fold: int, seed: int, test: ParticleRollout) -> dict[str, Any]:
    return {
        "environment": plan.environment,
        "model": name,
        "fold": fold,
        "seed": seed,
        "test": test.name,
        "seconds": plan.seconds,
        "horizon": plan.horizon,
        "device": plan.device,
    }


def trained(
    plan: ParticlePlan,
    name: str,
    training: list[ParticleRollout],
    chooser: ParticleRollout,
    test: ParticleRollout,
    seed: int,
) -> dict[str, Any]:
    """Train one network for the plan's time, choose its weights on one rollout, test it on another."""
    torch.manual_seed(seed)
    units, random = Units.of(training), np.random.default_rng(seed)
    network = MODELS[name](units).to(plan.device)
    optimiser = torch.optim.Adam(network.parameters(), lr=plan.learning_rate)
    averaged = averaged_model(network, 0.99)
    best, chosen, steps, spent, judged = math.inf, dict[str, Tensor](), 0, 0.0, 0
    checks = np.linspace(0.5, 1, plan.validations) * plan.seconds
    while judged < plan.validations:
        if spent >= checks[judged]:
            error = errors(open_loop(averaged.module, units, chooser), chooser.positions)["mean_l2_mm"]
            if error < best:
                best = error
                chosen = {key: value.clone() for key, value in averaged.module.state_dict().items()}
            judged += 1
            continue
        began = clock_s(plan.device)
        share = min(1.0, spent / plan.seconds)
        for group in optimiser.param_groups:
            group["lr"] = plan.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share)))
        loss = unrolled_loss(network, units, training, plan, random)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        averaged.update_parameters(network)
        steps, spent = steps + 1, spent + clock_s(plan.device) - began
    network.load_state_dict(chosen)
    began = clock_s(plan.device)
    predicted = open_loop(network.eval(), units, test)
    return {
        "errors": errors(predicted, test.positions),
        "validation_mean_l2_mm": best,
        "steps": steps,
        "parameters": sum(weight.numel() for weight in network.parameters()),
        "step_ms": 1e3 * (clock_s(plan.device) - began) / max(1, len(test) - 2),
    }


def clock_s(device: str) -> float:
    """Read the clock of the budget [s]."""
    if device == "cpu":
        return time.process_time()
    torch.cuda.synchronize()
    return time.perf_counter()


def unrolled_loss(
    network: nn.Module, units: Units, training: list[ParticleRollout], plan: ParticlePlan, random: np.random.Generator
) -> Tensor:
    """Squared error of the open loop over a few frames, the gradient through all of them.

    Every frame's error is divided by the frames since the start and by the typical change of displacement: a constant
    error of velocity counts the same in each.
    """
    moments = [_drawn(units, training, plan, random) for _ in range(plan.batch)]
    parts = []
    for ahead in range(1, plan.horizon + 1):
        moments = [each for each in moments if each.frame + 1 < len(each.rollout)]
        if not moments:
            break
        moments = stepped(network, units, moments)
        scale = ahead * units.change_m
        parts += [((each.now - each.rollout.positions[each.frame]) / scale).square().mean() for each in moments]
    return torch.stack(parts).mean()


def _drawn(units: Units, training: list[ParticleRollout], plan: ParticlePlan, random: np.random.Generator) -> Moment:
    """Draw a start. The noise is on the present: the network learns to return to the true next positions."""
    rollout = training[int(random.integers(len(training)))]
    frame = int(random.integers(1, max(2, len(rollout) - plan.horizon)))
    before, now = rollout.positions[frame - 1], rollout.positions[frame]
    drawn = torch.from_numpy(random.normal(size=now.shape).astype(np.float32)).to(now)
    return Moment(rollout, frame, now + drawn * (plan.noise * units.change_m), before)
