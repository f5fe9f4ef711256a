"""The faces of a cut: no Gaussian reaches through the blade that has passed it.

Gaussians inside an object are wide, for nothing has shown what is there. When a blade parts two halves, those beside
it would stick out of the fresh faces by several millimetres, and from both sides into the gap.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from plop.dynamics.interface import ParticleState, ToolStep
from plop.gaussians.covariance import scales_quats_from_covariance

_REACH = 1.0
"""Largest standard deviation across the cut, in distances of the Gaussian's centre from the blade's mid-plane [-]."""
_THINNEST_M = 2e-4
"""None gets thinner than this [m]: thinner ones would be split into ever smaller ones."""


def narrowed_at_cut(side: Tensor, after: ParticleState, action: ToolStep) -> ParticleState:
    """Narrow the Gaussians that the blade has passed in a step, along its normal.

    Args:
        side: Sides at the start of the step, shape [N].
        after: The state at its end, the same Gaussians in the same order.
        action: The step; its end pose counts.

    Returns:
        The state; shapes of Gaussians whose side has just been found are changed, nothing else.
    """
    rows = torch.nonzero((side == 0) & (after.side != 0)).squeeze(1)
    if len(rows) == 0:
        return after
    gaussians = after.gaussians
    pose = action.next_world_from_tool.to(gaussians.means)
    normal = pose[:3, :3] @ action.tool.axes.to(pose)[:, 0]
    distance, _ = action.tool.beside_blade((gaussians.means[rows] - pose[:3, 3]) @ pose[:3, :3])
    covariances = gaussians.select(rows).covariances
    across = torch.einsum("nij,i,j->n", covariances, normal, normal).clamp_min(1e-16).sqrt()
    kept = ((_REACH * distance.abs()).clamp_min(_THINNEST_M) / across).clamp_max(1)
    wide = kept < 1
    rows, kept, covariances = rows[wide], kept[wide], covariances[wide]
    squeeze = torch.eye(3, dtype=pose.dtype, device=pose.device) - (1 - kept)[:, None, None] * torch.outer(
        normal, normal
    )
    scales, quats = gaussians.scales.clone(), gaussians.quats.clone()
    scales[rows], quats[rows] = scales_quats_from_covariance(squeeze @ covariances @ squeeze)
    return replace(after, gaussians=gaussians.with_(scales=scales, quats=quats))
