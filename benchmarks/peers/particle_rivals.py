"""Trivial predictions of particle rollouts, which every table shows beside the learned ones."""

from __future__ import annotations

import torch
from torch import Tensor

from benchmarks.peers.particle_data import ParticleRollout
from plop.geometry.clouds.neighbours import nearest
from plop.geometry.rigid import kabsch

NOTES = {
    "persistence": "nothing moves",
    "velocity": "the first step's displacement is repeated",
    "replay": "the displacements of the training rollout whose particles and shapes begin most alike",
    "rigid": "the best rigid motion to the true positions of each frame: an oracle",
}


def rivals(rollout: ParticleRollout, training: list[ParticleRollout]) -> dict[str, Tensor]:
    """Predict a rollout trivially from its first two frames; "rigid" is an oracle.

    Returns:
        Rival -> positions of every frame, shape [T, N, 3] [m].
    """
    true, start = rollout.positions, rollout.positions[0]
    step = true[1] - true[0]
    times = torch.arange(len(true))[:, None, None]
    return {
        "persistence": start.expand_as(true),
        "velocity": start + times * step,
        "replay": _replayed(rollout, training),
        "rigid": torch.stack([_moved_rigidly(start, now) for now in true]),
    }


def _moved_rigidly(start: Tensor, now: Tensor) -> Tensor:
    pose = torch.from_numpy(kabsch(start.double().numpy(), now.double().numpy())).to(start)
    return start @ pose[:3, :3].T + pose[:3, 3]


def _replayed(rollout: ParticleRollout, training: list[ParticleRollout]) -> Tensor:
    start, best, least = rollout.positions[0], training[0], float("inf")
    for each in training:
        apart = float(nearest(each.positions[0], 1, queries=start)[0].mean())
        frames = min(len(each), len(rollout))
        if each.shapes.shape[1] == rollout.shapes.shape[1] > 0:
            apart += float((each.shapes[:frames] - rollout.shapes[:frames]).norm(dim=-1).mean())
        if apart < least:
            best, least = each, apart
    # The simulator numbers particles by place: with equal counts, row i of both is the same place in the body.
    same = best.positions.shape[1] == len(start)
    row = torch.arange(len(start)) if same else nearest(best.positions[0], 1, queries=start)[1][:, 0]
    moves = (best.positions - best.positions[0])[:, row]
    return start + moves[torch.arange(len(rollout)).clamp_max(len(best) - 1)]
