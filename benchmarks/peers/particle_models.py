"""I2N, DPI-Net and the transformer over bare particles: the networks of the models, one interface, equal inputs.

Each predicts the change of every particle's displacement in a step, in units of its typical size: a network that
gives 0 holds the velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from benchmarks.peers.particle_data import FEATURES, RADIUS_M, ParticleRollout
from plop.dynamics.i2n.network import I2N, I2NConfig, ParticleBatch
from plop.dynamics.peers.edges import Edges, radius_edges
from plop.dynamics.peers.propagation import PropagationNetwork
from plop.dynamics.peers.transformer import ParticleTransformer
from plop.geometry.rigid import kabsch


@dataclass(frozen=True)
class Units:
    """Scales of inputs and outputs, from the training rollouts."""

    motion_m: float
    """Root mean square of the displacement in a step [m]."""
    change_m: float
    """Root mean square of its change from step to step [m]."""
    length_m: float
    """Longest extent of the particles [m]."""

    @classmethod
    def of(cls, rollouts: list[ParticleRollout]) -> Units:
        """Measure the training rollouts."""
        moves = [each.positions.diff(dim=0) for each in rollouts]

        def size(parts: list[Tensor]) -> float:
            return max(1e-9, float(torch.cat([p.flatten() for p in parts]).square().mean().sqrt()))

        extents = [each.positions.amax((0, 1)) - each.positions.amin((0, 1)) for each in rollouts]
        return cls(size(moves), size([m.diff(dim=0) for m in moves]), float(torch.stack(extents).max()))


class OnGrid(nn.Module):
    """I2N with the network's own encoders; cells of one radius."""

    def __init__(self, units: Units) -> None:
        super().__init__()
        self.network = I2N(I2NConfig(features="contact"))

    def forward(self, positions: list[Tensor], features: list[Tensor]) -> list[Tensor]:
        """Predict, [N, 3] each."""
        none = positions[0].new_zeros(0, 8)
        counts = torch.tensor([len(each) for each in positions], device=none.device)
        batch = torch.arange(len(positions), device=none.device).repeat_interleave(counts)
        tool = ParticleBatch(none[:, :3], none, batch[:0])
        particles = ParticleBatch(torch.cat(positions), torch.cat(features), batch)
        out: Tensor = self.network(particles, tool, len(positions), RADIUS_M)[:, :3]
        return list(out.split([len(each) for each in positions]))


class OnGraph(nn.Module):
    """DPI-Net in index form, edges within its radius."""

    def __init__(self, units: Units, network: type[PropagationNetwork] = PropagationNetwork, most: int = 0) -> None:
        super().__init__()
        self.most, self.network = most, network(FEATURES, width=196, propagations=2)

    def forward(self, positions: list[Tensor], features: list[Tensor]) -> list[Tensor]:
        """Predict, [N, 3] each."""
        edges, first = [], 0
        for each in positions:
            own = radius_edges(each, len(each), RADIUS_M, self.most)
            edges.append(Edges(own.senders + first, own.receivers + first))
            first += len(each)
        joined = Edges(torch.cat([e.senders for e in edges]), torch.cat([e.receivers for e in edges]))
        out: Tensor = self.network(torch.cat(positions) / RADIUS_M, torch.cat(features), joined)
        return list(out.split([len(each) for each in positions]))


class OnAll(nn.Module):
    """The transformer."""

    def __init__(self, units: Units) -> None:
        super().__init__()
        self.length_m = units.length_m
        self.network = ParticleTransformer(FEATURES, width=128, layers=3, heads=4)

    def forward(self, positions: list[Tensor], features: list[Tensor]) -> list[Tensor]:
        """Predict, [N, 3] each."""
        return [self.network(*pair) for pair in zip([p / self.length_m for p in positions], features, strict=True)]


MODELS: dict[str, Callable[[Units], nn.Module]] = {"i2n": OnGrid, "dpi-net": OnGraph, "transformer": OnAll}


@dataclass(frozen=True)
class Moment:
    """A rollout at a frame: where the particles are, true or predicted."""

    rollout: ParticleRollout
    frame: int
    now: Tensor
    """Positions, shape [N, 3] [m]."""
    before: Tensor
    """Positions one frame earlier."""


def stepped(network: nn.Module, units: Units, moments: list[Moment]) -> list[Moment]:
    """Predict one frame of some rollouts at once."""
    features = [each.rollout.features(each.frame, each.now, each.before, units.motion_m) for each in moments]
    changes = network([each.now for each in moments], features)
    after = []
    for each, change in zip(moments, changes, strict=True):
        moved = 2 * each.now - each.before + change * units.change_m
        after.append(Moment(each.rollout, each.frame + 1, _kept_rigid(each.rollout, moved), each.now))
    return after


def _kept_rigid(rollout: ParticleRollout, moved: Tensor) -> Tensor:
    """Replace the motion of the rigid body by the best rigid one, as DPI-Net does; the gradient is that of `moved`."""
    if rollout.rigid == 0:
        return moved
    shape, after = (each[: rollout.rigid].detach().double().cpu().numpy() for each in (rollout.positions[0], moved))
    pose = torch.from_numpy(kabsch(shape, after)).to(moved)
    body = rollout.positions[0, : rollout.rigid] @ pose[:3, :3].T + pose[:3, 3]
    straight = moved[: rollout.rigid] + (body - moved[: rollout.rigid]).detach()
    return torch.cat([straight, moved[rollout.rigid :]])


@torch.no_grad()
def open_loop(network: nn.Module, units: Units, rollout: ParticleRollout) -> Tensor:
    """Roll out from frames 0 and 1 on, shape [T, N, 3] [m]; a particle that flies off stays at a finite distance."""
    states = [rollout.positions[0], rollout.positions[1]]
    for frame in range(1, len(rollout) - 1):
        after = stepped(network, units, [Moment(rollout, frame, states[-1], states[-2])])[0].now
        low, high = (states[-1] - 3 * units.length_m, states[-1] + 3 * units.length_m)
        after = torch.nan_to_num(after).clamp(low, high)
        middle, most = rollout.positions[0].mean(0), 2 * units.length_m
        states.append(after.clamp(middle - most, middle + most))
    return torch.stack(states)
