"""An arm that holds the tool from above and hides part of the view, like a robot's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.geometry.rigid import transform_points
from plop.geometry.view import MaskLabel, View

ARM_COLOUR = (45, 48, 52)


def hide_behind_arm(view: View, world_from_tool: np.ndarray, tool_vertices: np.ndarray, width_m: float) -> View:
    """Draw a straight arm from the upper end of the tool to the upper edge of the image.

    The arm is a strip that faces the camera, at the depth of the tool's upper end: everything behind it is
    hidden, and its pixels are labelled undecided in the mask, like those of a hand.

    Args:
        view: The image without the arm.
        world_from_tool: Pose of the tool, [4, 4].
        tool_vertices: The tool in its own frame, [K, 3] [m].
        width_m: Width of the arm [m].
    """
    camera = view.camera
    top = tool_vertices[:, 2].max()
    grip = np.append(tool_vertices[:, :2].mean(0), top)
    points = transform_points(world_from_tool, np.stack([grip, grip + [0, 0, 1e-2]]))
    pixels, depth = camera.project(points)
    if depth.min() <= 0:
        return view
    along = pixels[1] - pixels[0]
    along /= np.linalg.norm(along)
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    away = np.stack([columns, rows], -1) - pixels[0]
    half = width_m / 2 * camera.intrinsics[0, 0] / depth[0]
    arm = (away @ along > 0) & (np.abs(away @ [-along[1], along[0]]) < half)
    arm &= (view.depth_m == 0) | (view.depth_m > depth[0])
    rgb, measured, mask = view.rgb.copy(), view.depth_m.copy(), view.mask.copy()
    rgb[arm], measured[arm], mask[arm] = ARM_COLOUR, depth[0], MaskLabel.UNKNOWN
    return replace(view, rgb=rgb, depth_m=measured, mask=mask)
