"""What a camera shows at one instant: colour, depth and labels of every pixel, measured or drawn."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from plop.geometry.cameras import Camera


class MaskLabel(IntEnum):
    """Label of a pixel of a mask."""

    BACKGROUND = 0
    OBJECT = 1
    TOOL = 2
    UNKNOWN = 255
    """Not decided: ignored by losses and scores."""


@dataclass(frozen=True)
class View:
    """One frame of one camera."""

    camera: Camera
    rgb: np.ndarray
    """[H, W, 3] uint8"""
    depth_m: np.ndarray
    """[H, W] float32, 0 = not measured"""
    mask: np.ndarray
    """[H, W] uint8, MaskLabel"""

    @property
    def object_mask(self) -> np.ndarray:
        """Pixels that show the object, bool, shape [H, W]."""
        return np.asarray(self.mask == MaskLabel.OBJECT)

    @property
    def tool_mask(self) -> np.ndarray:
        """Pixels that show the tool, bool, shape [H, W]."""
        return np.asarray(self.mask == MaskLabel.TOOL)

    @property
    def depth_without_tool_m(self) -> np.ndarray:
        """Depth of the static scene, float32 [H, W] [m]; 0 at pixels of the tool or labelled undecided (a hand)."""
        return np.where(self.tool_mask | (self.mask == MaskLabel.UNKNOWN), np.float32(0), self.depth_m)
