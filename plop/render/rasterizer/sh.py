"""Real spherical harmonics up to degree 3, with the signs and order of standard splat files.

Source: 3D Gaussian Splatting (Kerbl et al. 2023), reference implementation; the basis is that of
Sloan, "Efficient Spherical Harmonic Evaluation" (2013).
"""

from __future__ import annotations

import torch
from torch import Tensor

C0 = 0.28209479177387814
C1 = 0.4886025119029199
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)

TERMS_OF_DEGREE = (1, 4, 9, 16)
"""Number of coefficients K per colour channel for degrees 0 to 3."""


def sh_basis(directions: Tensor, terms: int) -> Tensor:
    """Evaluate the basis functions.

    Args:
        directions: Unit vectors from the camera to the Gaussian, world frame, shape [N, 3].
        terms: Number of coefficients K: 1, 4, 9 or 16.

    Returns:
        Values of the basis, shape [N, K].
    """
    x, y, z = directions.unbind(-1)
    basis = [torch.full_like(x, C0)]
    if terms > 1:
        basis += [-C1 * y, C1 * z, -C1 * x]
    if terms > 4:
        basis += [
            C2[0] * x * y,
            -C2[0] * y * z,
            C2[1] * (2 * z * z - x * x - y * y),
            -C2[0] * x * z,
            C2[2] * (x * x - y * y),
        ]
    if terms > 9:
        basis += [
            -C3[0] * y * (3 * x * x - y * y),
            C3[1] * x * y * z,
            -C3[2] * y * (4 * z * z - x * x - y * y),
            C3[3] * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -C3[2] * x * (4 * z * z - x * x - y * y),
            C3[4] * z * (x * x - y * y),
            -C3[0] * x * (x * x - 3 * y * y),
        ]
    return torch.stack(basis, dim=-1)


def sh_to_rgb(sh: Tensor, directions: Tensor) -> Tensor:
    """Evaluate the colour seen from one direction per Gaussian.

    Args:
        sh: Coefficients, shape [N, K, 3].
        directions: Unit vectors from the camera to the Gaussian, shape [N, 3].

    Returns:
        Colour max(0, basis . sh + 0.5), shape [N, 3]; not clamped above.
    """
    basis = sh_basis(directions, sh.shape[1])
    return torch.clamp_min((basis[:, :, None] * sh).sum(dim=1) + 0.5, 0.0)
