"""Contact with a pressing tool, which hides the object from all cameras: no part of the object is inside it."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from plop.dynamics.cut import is_blade
from plop.geometry.meshes.tool import ToolGeometry

_SOLID = 0.7
"""Share of its convex hull that a tool fills at least to count as solid: hollows, as between two fingers, may hold the
object."""


@dataclass(frozen=True)
class SolidTool:
    """A pressing tool at one instant, approximated by its convex hull."""

    tool: ToolGeometry
    world_from_tool: Tensor
    """Shape [4, 4]."""

    @classmethod
    def of(cls, tool: ToolGeometry, world_from_tool: Tensor) -> SolidTool | None:
        """Return the tool as an obstacle; None for a blade, which enters the material, and for a hollow tool."""
        return None if is_blade(tool) or tool.filled < _SOLID else cls(tool, world_from_tool)

    def overlap_m(self, means: Tensor) -> Tensor:
        """Return the mean penetration depth of points [N, 3] [m] over all of them [m], scalar."""
        pose = self.world_from_tool.to(means)
        return self.tool.depth_inside((means - pose[:3, 3]) @ pose[:3, :3]).mean()
