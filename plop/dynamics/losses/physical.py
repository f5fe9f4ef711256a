"""The physical terms of PLOP's loss (Eq. 15), after Dynamic 3D Gaussians (Luiten et al., 2024).

Every Gaussian has k neighbours at frame 0. Rigidity and rotation compare two frames, isometry compares
with frame 0; each is a mean over Gaussians and neighbours with the weight inside the root. A blade that
has passed between two neighbours severs them (`paper` keeps them): otherwise the terms would hold the cut
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from plop.dynamics.losses.pair_sums import alike_sum, rigid_sum, stretched_sum
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.neighbours import nearest
from plop.geometry.rigid import quat_conjugate, quat_multiply, quat_to_matrix


@dataclass(frozen=True)
class Neighbourhood:
    """Pairs of Gaussians that were neighbours at frame 0."""

    first: Tensor
    """Index i, shape [E], int64."""
    second: Tensor
    """Index j, shape [E], int64."""
    rest_m: Tensor
    """Distance at frame 0, shape [E] [m]."""
    weight: Tensor
    """exp(-2000 d^2) with d in a unit of length, shape [E]."""

    @classmethod
    def of(cls, means: Tensor, count: int = 20, *, unit_m: float = 1.0) -> Neighbourhood:
        """Find the neighbours at frame 0.

        Args:
            means: Shape [N, 3] [m].
            count: Neighbours of each Gaussian.
            unit_m: Unit of length of the weights [m]: the metre, or that of the scene.
        """
        distance, index = nearest(means, count)
        first = torch.arange(len(means), device=means.device)[:, None].expand_as(index).reshape(-1)
        rest = distance.reshape(-1)
        return cls(first, index.reshape(-1), rest, torch.exp(-2000 * (rest / unit_m).square()))

    def severed(self, side: Tensor) -> Neighbourhood:
        """Leave out the pairs that lie on different sides of the cut; `side` has shape [N]."""
        keep = side[self.first] * side[self.second] >= 0
        return Neighbourhood(self.first[keep], self.second[keep], self.rest_m[keep], self.weight[keep])

    def following(self, parents: Tensor) -> Neighbourhood:
        """Map the pairs to a resampled set.

        Args:
            parents: For each new Gaussian the index of the old one it descends from, shape [M].

        Returns:
            For each surviving pair, the pair of the first descendants.
        """
        size = int(max(self.first.max(), self.second.max())) + 1 if len(self.first) else 0
        place = torch.full((max(size, int(parents.max()) + 1),), -1, dtype=torch.int64, device=parents.device)
        order = torch.arange(len(parents), device=parents.device).flip(0)
        place[parents[order]] = order
        first, second = place[self.first], place[self.second]
        keep = (first >= 0) & (second >= 0)
        return Neighbourhood(first[keep], second[keep], self.rest_m[keep], self.weight[keep])


def rigidity(pairs: Neighbourhood, before: Gaussians, after: Gaussians) -> Tensor:
    """Neighbours keep their position in the rotating frame of a Gaussian [m], scalar."""
    turn = quat_to_matrix(quat_multiply(after.quats, quat_conjugate(before.quats)))
    total = rigid_sum(pairs.first, pairs.second, pairs.weight, turn, after.means, before.means)
    return total / max(len(pairs.first), 1)


def rotation_similarity(pairs: Neighbourhood, before: Gaussians, after: Gaussians) -> Tensor:
    """Neighbours rotate alike: difference of their rotations as quaternions, scalar."""
    turn = quat_multiply(after.quats, quat_conjugate(before.quats))
    return alike_sum(pairs.first, pairs.second, pairs.weight, turn) / max(len(pairs.first), 1)


def isometry(pairs: Neighbourhood, now: Gaussians) -> Tensor:
    """Neighbours keep their distance of frame 0 [m], scalar."""
    total = stretched_sum(pairs.first, pairs.second, pairs.weight, pairs.rest_m, now.means)
    return total / max(len(pairs.first), 1)


def local_rotations(pairs: Neighbourhood, before: Tensor, after: Tensor, count: int) -> Tensor:
    """Best rotation of each particle's neighbourhood between two frames (Kabsch).

    Args:
        pairs: Neighbours, severed ones left out.
        before: Means, shape [N, 3] [m].
        after: Means, shape [N, 3] [m].
        count: N.

    Returns:
        Rotation matrices, shape [N, 3, 3]; identity where a particle has fewer than 3 neighbours.
    """
    then = before[pairs.second] - before[pairs.first]
    now = after[pairs.second] - after[pairs.first]
    outer = pairs.weight[:, None, None] * now[:, :, None] * then[:, None, :]
    total = before.new_zeros(count, 3, 3).index_add_(0, pairs.first, outer)
    degree = before.new_zeros(count).index_add_(0, pairs.first, torch.ones_like(pairs.weight))
    # A small multiple of the identity keeps flat neighbourhoods well posed.
    scale = total.diagonal(dim1=-2, dim2=-1).abs().sum(-1).clamp_min(1e-20)
    identity = torch.eye(3, dtype=before.dtype, device=before.device)
    u, _, vt = torch.linalg.svd(total + 0.02 * scale[:, None, None] * identity)
    flip = before.new_ones(count, 3)
    flip[:, 2] = torch.linalg.det(u @ vt)
    rotation = (u * flip[:, None, :]) @ vt
    return torch.where((degree >= 3)[:, None, None], rotation, identity)
