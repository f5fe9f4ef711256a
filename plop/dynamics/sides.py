"""On which side of the cut a particle lies.

A blade that has passed a particle's place divides the material there. The side is fixed the first time
the blade's outline covers the particle, seen along the blade's normal, and stays with it afterwards.
"""

from __future__ import annotations

import torch
from torch import Tensor

from plop.dynamics.interface import ToolStep
from plop.geometry.tool import ToolGeometry

BLADE_RATIO = 5.0
"""A tool is a blade when its two longer extents exceed the shortest this many times."""


def is_blade(tool: ToolGeometry) -> bool:
    """Tell whether the tool is thin enough to divide material."""
    return bool(tool.half_extent[1] > BLADE_RATIO * tool.half_extent[0])


def advance_sides(side: Tensor, means: Tensor, action: ToolStep) -> Tensor:
    """Mark the particles that the blade has reached.

    Args:
        side: Shape [N], -1, 0 or 1.
        means: Positions at the end of the step, shape [N, 3] [m].
        action: The step; its end pose counts.

    Returns:
        New sides, shape [N]. Marked particles keep theirs.
    """
    if not is_blade(action.tool):
        return side
    pose = action.next_world_from_tool.to(means)
    distance, beyond = action.tool.beside_blade((means.detach() - pose[:3, 3]) @ pose[:3, :3])
    reached = torch.where(distance >= 0, 1.0, -1.0).to(side)
    return torch.where((side == 0) & (beyond <= 0), reached, side)
