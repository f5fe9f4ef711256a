"""Move a set of Gaussians as one rigid body: a tool with its pose, an object that does not deform."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from plop.gaussians.state import Gaussians
from plop.geometry.rigid import matrix_to_quat, quat_multiply
from plop.render.rasterizer.sh import sh_basis


def moved_rigidly(gaussians: Gaussians, transform: Tensor | np.ndarray) -> Gaussians:
    """Transform Gaussians rigidly; colours rotate with the body.

    Args:
        gaussians: N Gaussians, e.g. a tool in its own frame.
        transform: Shape [4, 4], e.g. `world_from_tool`, translation in metres.

    Returns:
        The same Gaussians moved; differentiable in the Gaussians.
    """
    pose = torch.as_tensor(transform).to(gaussians.means)
    rotation = pose[:3, :3]
    turn = matrix_to_quat(rotation).expand_as(gaussians.quats)
    return gaussians.with_(
        means=gaussians.means @ rotation.T + pose[:3, 3],
        quats=quat_multiply(turn, gaussians.quats),
        sh=rotated_sh(gaussians.sh, rotation),
    )


def rotated_sh(sh: Tensor, rotation: Tensor) -> Tensor:
    """Rotate spherical harmonics so that the colour seen along R d is that seen before along d.

    Rotations map each degree onto itself, so the matrix that does it is the exact solution
    of a small linear system: the basis at fixed directions against the basis at rotated ones.

    Args:
        sh: Coefficients, shape [N, K, 3], K = 1, 4, 9 or 16.
        rotation: Shape [3, 3].

    Returns:
        Rotated coefficients, shape [N, K, 3].
    """
    terms = sh.shape[1]
    if terms == 1:
        return sh
    directions = torch.randn(64, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    directions = torch.nn.functional.normalize(directions, dim=-1)
    back = directions @ rotation.detach().cpu().double()
    turn = torch.linalg.lstsq(sh_basis(directions, terms), sh_basis(back, terms)).solution
    return torch.einsum("jk,nkc->njc", turn.to(sh), sh)
