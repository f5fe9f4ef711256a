"""Gaussians follow control points: linear blend skinning by the points' rigid motions (gs-dynamics, Sec. 3.3).

The motion of a control point is its translation, and the rotation that fits the motion of its neighbours best. A
Gaussian moves by the weighted mean of what these motions would do to it; its rotation is the blended quaternion.
"""

from __future__ import annotations

import torch
from torch import Tensor

from plop.geometry.clouds.neighbours import nearest
from plop.geometry.rigid import matrix_to_quat, quat_from_rotation_vector, quat_multiply, quat_to_matrix

NEIGHBOURS = 8
"""Neighbours that determine the rotation of a control point."""
_LEAST = 4
"""Fewer points do not determine a rotation."""
_SOFT = 1e-3
"""Regularisation of the gradient where points lie on a line, in units of their spread [-]."""
_NEAREST_M = 1e-4
"""Smallest distance in a weight [m]."""


def local_turns(before: Tensor, after: Tensor) -> Tensor:
    """Fit the rotation of every point's neighbourhood (Kabsch).

    The gradient is exact: with R the best rotation and S the symmetric factor of R^T M, a change of M turns R by
    w = (tr(S) I - S)^-1 axial(R^T dM), which is added as a rotation of value zero.

    Args:
        before: Positions, shape [n, 3] [m].
        after: Positions after the step, shape [n, 3] [m].

    Returns:
        Unit quaternions wxyz with w >= 0, shape [n, 4]; no rotation where there are fewer than four points.
    """
    if len(before) < _LEAST:
        return before.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(len(before), 4)
    index = nearest(before, NEIGHBOURS)[1]
    then, now = (points[index] - points[:, None] for points in (before, after))
    spread = now.transpose(1, 2) @ then
    with torch.no_grad():
        left, _, right = torch.linalg.svd(spread.double())
        flip = torch.ones_like(left[:, 0])
        flip[:, 2] = torch.det(left @ right).sign()
        best = ((left * flip[:, None]) @ right).to(spread)
    inner = best.transpose(1, 2) @ spread
    twice = inner - inner.transpose(1, 2)
    axial = torch.stack([twice[:, 2, 1], twice[:, 0, 2], twice[:, 1, 0]], dim=1)
    size = inner.detach().diagonal(dim1=1, dim2=2).sum(1)[:, None, None].clamp_min(1e-20)
    unit = torch.eye(3, dtype=before.dtype, device=before.device)
    resists = unit * (1 + _SOFT) - (inner + inner.transpose(1, 2)).detach() / (2 * size)
    small = torch.linalg.solve(resists, (axial / size[:, 0])[..., None])[..., 0]
    return quat_multiply(matrix_to_quat(best), quat_from_rotation_vector(small - small.detach()))


def skin_weights(points: Tensor, bones: Tensor, count: int) -> Tensor:
    """Weigh control points by the inverse of their distance.

    Args:
        points: Positions of the Gaussians, shape [N, 3] [m].
        bones: Control points, shape [n, 3] [m].
        count: Nearest ones that count; 0: all.

    Returns:
        Shape [N, n]; each row sums to 1; without gradient.
    """
    distance = torch.cdist(points.detach(), bones.detach(), compute_mode="donot_use_mm_for_euclid_dist")
    weights = 1 / distance.clamp_min(_NEAREST_M)
    if 0 < count < len(bones):
        kept = distance.topk(count, dim=1, largest=False).indices
        weights = torch.zeros_like(weights).scatter(1, kept, weights.gather(1, kept))
    return weights / weights.sum(1, keepdim=True)


def skinned(points: Tensor, bones: Tensor, moved: Tensor, turns: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Move points with control points.

    Args:
        points: Shape [N, 3] [m].
        bones: Control points before the step, shape [n, 3] [m].
        moved: After it.
        turns: Their rotations, unit quaternions, shape [n, 4].
        weights: From `skin_weights`, shape [N, n].

    Returns:
        Positions [N, 3] [m], and rotations as unit quaternions [N, 4].
    """
    matrices = quat_to_matrix(turns)
    rest = moved - (matrices @ bones[..., None])[..., 0]
    blended = weights @ torch.cat([matrices.flatten(1), rest, turns], dim=1)
    rotation, shift, quats = blended.split([9, 3, 4], dim=1)
    places = (rotation.reshape(-1, 3, 3) @ points[..., None])[..., 0] + shift
    return places, torch.nn.functional.normalize(quats, dim=1)
