"""Render an object with its tool as a camera measures it: colour, depth, mask."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from plop.gaussians.state import Gaussians, concatenate
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.render.rasterizer.rasterize import Backend, render, render_many
from plop.render.rasterizer.sh import C0
from plop.render.rigid_motion import moved_rigidly


def tool_above_table(tool: Gaussians, world_from_tool: np.ndarray, table_z_m: float | None) -> Gaussians:
    """Transform a tool by its pose, without the part below a table, which cameras above it do not see.

    Args:
        tool: In its own frame.
        world_from_tool: Its pose, [4, 4].
        table_z_m: Height of the table [m]; None for no table.

    Returns:
        The tool in the world; the Gaussians below the table are left out.
    """
    placed = moved_rigidly(tool, world_from_tool)
    return placed if table_z_m is None else placed.select(placed.means[:, 2] >= table_z_m)


@torch.no_grad()
def render_scene(
    object_gaussians: Gaussians, tool_gaussians: Gaussians | None, cameras: list[Camera], *, backend: Backend = "auto"
) -> list[View]:
    """Render object and tool together, over black.

    A pixel belongs to the largest contribution: the object, the tool or the background.
    Its depth is the expected depth of that contribution only, so that a pixel at the blade's
    edge does not lie between blade and object.

    Args:
        object_gaussians: The object, world frame.
        tool_gaussians: The tool, world frame (see `tool_above_table`); None for no tool.
        cameras: Views.
        backend: See `plop.render.rasterizer.rasterize.render`.

    Returns:
        One view per camera, comparable with a recording's views.
    """
    parts = [object_gaussians] if tool_gaussians is None else [object_gaussians, tool_gaussians]
    scene = concatenate(parts)
    is_object = torch.zeros(len(scene), dtype=torch.bool, device=scene.means.device)
    is_object[: len(object_gaussians)] = True
    colours = render_many(scene, cameras, backend=backend)
    views = []
    for camera, colour in zip(cameras, colours, strict=True):
        depth, mask = _labels(scene, is_object, camera, backend)
        rgb = (colour.rgb.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
        views.append(View(camera, rgb, depth, mask))
    return views


def _labels(scene: Gaussians, is_object: Tensor, camera: Camera, backend: Backend) -> tuple[np.ndarray, np.ndarray]:
    """Render contributions as colours: red is the object, green the tool, blue the object's depth."""
    pose = torch.as_tensor(camera.cam_from_world).to(scene.means)
    depth = (scene.means @ pose[2, :3] + pose[2, 3]).clamp_min(0)
    reach = depth.max().clamp_min(1e-6) if len(scene) else depth.new_ones(())
    owner = is_object.to(scene.means)
    painted = torch.stack([owner, 1 - owner, owner * depth / reach], dim=-1)
    image = render(scene.with_(sh=((painted - 0.5) / C0)[:, None, :]), camera, backend=backend)
    of_object, of_tool, object_depth = image.rgb.unbind(-1)
    behind = 1 - image.alpha
    mask = torch.full_like(of_object, MaskLabel.BACKGROUND, dtype=torch.uint8)
    mask[(of_tool > of_object) & (of_tool > behind)] = MaskLabel.TOOL
    mask[(of_object >= of_tool) & (of_object > behind)] = MaskLabel.OBJECT
    tool_depth = image.depth_m * image.alpha - object_depth * reach
    metres = torch.zeros_like(of_object)
    metres = torch.where(mask == MaskLabel.OBJECT, object_depth * reach / of_object.clamp_min(1e-6), metres)
    metres = torch.where(mask == MaskLabel.TOOL, tool_depth / of_tool.clamp_min(1e-6), metres)
    return metres.float().cpu().numpy(), mask.cpu().numpy()
