"""The state of an object: a set of 3D Gaussians (PLOP, Eq. 5)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from plop.geometry.rigid import quat_to_matrix


@dataclass(frozen=True)
class Gaussians:
    """A set of N Gaussians; opacity is the particle's weight in the filter.

    Everything is in physical units; logits and logarithms belong to optimisers and files.
    """

    means: Tensor
    """World positions, shape [N, 3] [m]."""
    quats: Tensor
    """Unit rotations wxyz, shape [N, 4]."""
    scales: Tensor
    """Standard deviations along the rotated axes, shape [N, 3] [m]."""
    opacities: Tensor
    """Peak opacity in [0, 1], shape [N]."""
    sh: Tensor
    """Spherical harmonics of the colour, shape [N, K, 3], K = (degree + 1)^2, as in standard splat files."""
    ids: Tensor
    """Lineage: the index of the ancestor at frame 0, shape [N], int64."""

    def __len__(self) -> int:
        return self.means.shape[0]

    @property
    def covariances(self) -> Tensor:
        """Covariance matrices R S S^T R^T, shape [N, 3, 3] [m^2]."""
        half = quat_to_matrix(self.quats) * self.scales[:, None, :]
        return half @ half.transpose(-1, -2)

    def select(self, index: Tensor) -> Gaussians:
        """Take a subset by boolean mask or by indices."""
        return Gaussians(*(getattr(self, f.name)[index] for f in fields(self)))

    def with_(self, **changes: Tensor) -> Gaussians:
        """Copy with some fields replaced."""
        return replace(self, **changes)

    def detach(self) -> Gaussians:
        """Copy without gradient history."""
        return Gaussians(*(getattr(self, f.name).detach() for f in fields(self)))

    def to(self, device: torch.device | str) -> Gaussians:
        """Copy on another device."""
        return Gaussians(*(getattr(self, f.name).to(device) for f in fields(self)))


def concatenate(parts: list[Gaussians]) -> Gaussians:
    """Join sets of Gaussians; sh is padded with zeros to the highest degree among them."""
    terms = max(part.sh.shape[1] for part in parts)

    def padded(sh: Tensor) -> Tensor:
        return torch.cat([sh, sh.new_zeros(sh.shape[0], terms - sh.shape[1], 3)], dim=1)

    joined = {f.name: torch.cat([getattr(p, f.name) for p in parts]) for f in fields(Gaussians) if f.name != "sh"}
    return Gaussians(**joined, sh=torch.cat([padded(part.sh) for part in parts]))
