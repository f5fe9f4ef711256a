"""Sets of Gaussians that the tests of this folder share."""

from __future__ import annotations

import torch
from torch import Tensor

from plop.gaussians.state import Gaussians


def random_gaussians(count: int, *, seed: int = 0, terms: int = 4, dtype: torch.dtype = torch.float32) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=dtype)

    return Gaussians(
        means=0.1 * uniform(count, 3) - 0.05,
        quats=torch.nn.functional.normalize(uniform(count, 4) - 0.5, dim=-1),
        scales=0.001 + 0.009 * uniform(count, 3),
        opacities=0.05 + 0.9 * uniform(count),
        sh=uniform(count, terms, 3) - 0.5,
        ids=torch.arange(count) + 7,
    )


def total_moments(gaussians: Gaussians) -> tuple[Tensor, Tensor, Tensor]:
    """Weight, mean and covariance of the mixture, with opacities as weights."""
    weight = gaussians.opacities / gaussians.opacities.sum()
    mean = (weight[:, None] * gaussians.means).sum(0)
    offset = gaussians.means - mean
    spread = gaussians.covariances + offset[:, :, None] * offset[:, None, :]
    return gaussians.opacities.sum(), mean, (weight[:, None, None] * spread).sum(0)


def sphere_shell(count: int, radius_m: float = 0.05, *, flat: float = 0.4) -> Gaussians:
    """Flat Gaussians over a whole sphere, dense enough to be closed."""
    index = torch.arange(count) + 0.5
    polar, turn = torch.acos(1 - 2 * index / count), torch.pi * (1 + 5**0.5) * index
    normals = torch.stack([turn.cos() * polar.sin(), turn.sin() * polar.sin(), polar.cos()], dim=-1)
    spacing = radius_m * (4 * torch.pi / count) ** 0.5
    quats = torch.cat([1 + normals[:, 2:], -normals[:, 1:2], normals[:, :1], torch.zeros(count, 1)], dim=1)
    along = torch.full((count,), 0.6 * spacing)
    return Gaussians(
        means=radius_m * normals,
        quats=torch.nn.functional.normalize(quats, dim=-1),
        scales=torch.stack([along, along, flat * along], dim=-1),
        opacities=torch.full((count,), 0.95),
        sh=normals[:, None] * 0.5,
        ids=torch.arange(count),
    )
