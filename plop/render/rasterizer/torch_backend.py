"""The reference rasterizer in plain torch: slow and short; the fast backends are tested against it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.projection import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN, Splats, project

CHUNK_PAIRS = 4_000_000
"""Pixel-Gaussian pairs in memory at once; larger images are recomputed chunk by chunk in the backward pass."""


def render_torch(gaussians: Gaussians, cameras: list[Camera], background: Tensor, near_m: float) -> list[Rendering]:
    """Render by evaluating every Gaussian at every pixel; follows the dtype and device of the Gaussians.

    Args:
        gaussians: N Gaussians, world frame.
        cameras: The views.
        background: Colour behind everything, shape [3].
        near_m: Near plane [m].

    Returns:
        One view per camera; differentiable by autograd, in float64 too.
    """
    return [_render_one(gaussians, camera, background, near_m) for camera in cameras]


def _render_one(gaussians: Gaussians, camera: Camera, background: Tensor, near_m: float) -> Rendering:
    splats = project(gaussians, camera, near_m)
    like = gaussians.means
    columns = torch.arange(camera.width, dtype=like.dtype, device=like.device) + 0.5
    rows = torch.arange(camera.height, dtype=like.dtype, device=like.device) + 0.5
    grid = torch.meshgrid(rows, columns, indexing="ij")
    pixels = torch.stack([grid[1], grid[0]], dim=-1).reshape(-1, 2)

    chunks = pixels.split(max(1, CHUNK_PAIRS // max(1, len(splats.depth_m))))
    if len(chunks) == 1:
        sums = _composite(splats, pixels)
    else:
        sums = torch.cat([checkpoint(_composite, splats, chunk, use_reentrant=False) for chunk in chunks])
    sums = sums.reshape(camera.height, camera.width, 5)
    alpha = sums[..., 4]
    rgb = sums[..., :3] + (1 - alpha)[..., None] * background
    return Rendering(rgb=rgb, depth_m=sums[..., 3] / alpha.clamp_min(1e-6), alpha=alpha)


def _composite(splats: Splats, pixels: Tensor) -> Tensor:
    """Blend the sorted splats front to back at pixel centres [P, 2]: sums of (r, g, b, depth, 1), [P, 5]."""
    dx, dy = (pixels[:, None, :] - splats.means_px[None]).unbind(-1)
    xx, xy, yy = splats.conics.unbind(-1)
    exponent = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
    alpha = (splats.opacities * torch.exp(-exponent)).clamp_max(ALPHA_MAX)
    alpha = torch.where((alpha >= ALPHA_MIN) & (exponent >= 0), alpha, torch.zeros_like(alpha))
    after = torch.cumprod(1 - alpha, dim=1)
    before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)
    weights = torch.where(after > TRANSMITTANCE_MIN, alpha * before, torch.zeros_like(alpha))
    values = torch.cat([splats.rgb, splats.depth_m[:, None], torch.ones_like(splats.depth_m)[:, None]], dim=1)
    return weights @ values
