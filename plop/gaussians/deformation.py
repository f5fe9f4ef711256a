"""Gaussians that move and deform with a material."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from plop.gaussians.covariance import scales_quats_from_covariance
from plop.gaussians.state import Gaussians
from plop.geometry.rigid import matrix_to_quat, rotation_vector_from_quat


def deformed(gaussians: Gaussians, positions: np.ndarray, turned: np.ndarray) -> tuple[Gaussians, Tensor]:
    """Move Gaussians to new positions and deform their covariances.

    Args:
        gaussians: N Gaussians.
        positions: New means, [N, 3] [m].
        turned: Deformation gradient since the old positions, [N, 3, 3].

    Returns:
        The Gaussians, and the rotation vector of each deformation, [N, 3] [rad].
    """
    means = torch.from_numpy(np.asarray(positions)).to(gaussians.means)
    deform = torch.from_numpy(np.asarray(turned)).to(gaussians.means)
    scales, quats = scales_quats_from_covariance(deform @ gaussians.covariances @ deform.transpose(1, 2))
    left, _, right = torch.linalg.svd(deform.double())
    rotation = rotation_vector_from_quat(matrix_to_quat(left @ right)).to(gaussians.means)
    return gaussians.with_(means=means, scales=scales, quats=quats), rotation
