"""The cut: on which side of it a particle lies, and its faces, which no Gaussian crosses.

A blade that has passed a particle's place divides the material there. The side is fixed the first time
the blade's outline covers the particle, seen along the blade's normal, and stays with it afterwards.
Gaussians inside an object are wide, because no image constrains them. When a blade separates two halves, those beside
it would extend from the new faces by several millimetres, from both sides into the gap.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from plop.dynamics.interface import ParticleState, ToolStep
from plop.gaussians.covariance import scales_quats_from_covariance
from plop.geometry.meshes.tool import ToolGeometry

BLADE_RATIO = 5.0
"""A tool is a blade when its two longer extents exceed the shortest this many times."""
_REACH = 1.0
"""Largest standard deviation across the cut, in distances of the Gaussian's centre from the blade's mid-plane [-]."""
_THINNEST_M = 2e-4
"""Smallest standard deviation [m]: thinner ones would be split into ever smaller ones."""


def is_blade(tool: ToolGeometry) -> bool:
    """Return whether the tool is thin enough to divide material."""
    return bool(tool.half_extent[1] > BLADE_RATIO * tool.half_extent[0])


def advance_sides(side: Tensor, means: Tensor, action: ToolStep) -> Tensor:
    """Set the sides of the particles that the blade has reached.

    Args:
        side: Shape [N], -1, 0 or 1.
        means: Positions at the end of the step, shape [N, 3] [m].
        action: The step; its end pose is used.

    Returns:
        New sides, shape [N]. Particles with a side keep it.
    """
    if not is_blade(action.tool):
        return side
    pose = action.next_world_from_tool.to(means)
    distance, beyond = action.tool.beside_blade((means.detach() - pose[:3, 3]) @ pose[:3, :3])
    reached = torch.where(distance >= 0, 1.0, -1.0).to(side)
    return torch.where((side == 0) & (beyond <= 0), reached, side)


def narrowed_at_cut(side: Tensor, after: ParticleState, action: ToolStep) -> ParticleState:
    """Narrow the Gaussians that the blade has passed in a step, along its normal.

    Args:
        side: Sides at the start of the step, shape [N].
        after: The state at its end, the same Gaussians in the same order.
        action: The step; its end pose counts.

    Returns:
        The state; only shapes of Gaussians whose side was set in this step are changed.
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
