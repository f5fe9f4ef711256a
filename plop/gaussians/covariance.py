"""Conversion of covariance matrices to scales and rotations."""

from __future__ import annotations

import torch
from torch import Tensor

from plop.geometry.rigid import matrix_to_quat

MIN_SCALE_M = 1e-7
"""Smallest standard deviation that a decomposition returns [m]."""


def scales_quats_from_covariance(covariances: Tensor) -> tuple[Tensor, Tensor]:
    """Decompose covariances, Sigma = R diag(scales^2) R^T.

    The gradient reaches the scales through lambda_k = e_k^T Sigma e_k with the
    eigenvectors e_k held fixed, which is the exact derivative of an eigenvalue and
    stays finite when two of them meet. The rotation has no gradient: that of an
    eigenvector grows without bound there.

    Args:
        covariances: Symmetric matrices, shape [N, 3, 3], m^2.

    Returns:
        Scales in ascending order, shape [N, 3], m, and unit quaternions wxyz, shape [N, 4].
    """
    if covariances.shape[0] == 0:
        return covariances.new_zeros(0, 3), covariances.new_zeros(0, 4)
    with torch.no_grad():
        # In float64 and at unit size: 1e-6 m^2 is too close to zero for a float32 decomposition.
        exact = covariances.double()
        size = exact.diagonal(dim1=-2, dim2=-1).amax(-1).clamp_min(MIN_SCALE_M**2)[:, None, None]
        axes = torch.linalg.eigh(exact / size).eigenvectors
        axes = torch.where(torch.det(axes)[:, None, None] < 0, -axes, axes)
        quats = matrix_to_quat(axes).to(covariances)
        axes = axes.to(covariances)
    variances = torch.einsum("nik,nij,njk->nk", axes, covariances, axes)
    return variances.clamp_min(MIN_SCALE_M**2).sqrt(), quats
