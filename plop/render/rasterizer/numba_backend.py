"""The CPU backend: tile-based Gaussian splatting with a hand-written gradient, compiled by numba.

The stages and their kernels: project (numba_project), colour (numba_colour), sort and list (numba_bins),
blend (numba_blend). All views of a call share one pass through them.
No library, since gsplat, which plop uses on a GPU, has no kernels for the CPU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from plop.compute.cpu_kernels import array_of, run_parallel
from plop.compute.numba_lanes import LANES
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.numba_bins import TILE_HEIGHT, TILE_WIDTH, list_intersections
from plop.render.rasterizer.numba_blend import blend_backward, blend_forward
from plop.render.rasterizer.numba_project import (
    CENTRE,
    EYE,
    FOCAL,
    LIMITS,
    NEAR,
    POSE,
    SPLAT,
    VIEW,
    project_backward,
    project_forward,
)
from plop.render.rasterizer.projection import jacobian_limits


def render_numba(gaussians: Gaussians, cameras: list[Camera], background: Tensor, near_m: float) -> list[Rendering]:
    """Render on the CPU in float32.

    Args:
        gaussians: N Gaussians, world frame, on the CPU.
        cameras: The views, all of one size; they share one pass.
        background: Colour behind everything, shape [3].
        near_m: Near plane [m].

    Returns:
        One view per camera, in the dtype of the means, differentiable by autograd (once).

    Raises:
        PlopError: The tensors are not on the CPU.
    """
    like = gaussians.means
    if like.device.type != "cpu":
        found = f"tensors on {like.device}"
        raise PlopError("The numba rasterizer runs on the CPU only.", found=found, fix="Choose the backend auto.")
    views = np.stack([pack_view(camera, near_m) for camera in cameras])
    fields = (gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh)
    images = _Rasterize.apply(*(field.float() for field in fields), views, cameras[0].width, cameras[0].height)
    renderings = []
    for v in range(len(cameras)):
        rgb, depth, alpha = (image.to(like) for image in images[3 * v : 3 * v + 3])
        if background.requires_grad or background.any():
            rgb = rgb + (1 - alpha)[..., None] * background
        renderings.append(Rendering(rgb, depth, alpha))
    return renderings


def pack_view(camera: Camera, near_m: float) -> np.ndarray:
    """Pack a camera for the kernels, float64, shape [VIEW] (see numba_project)."""
    k = camera.intrinsics
    view = np.zeros(VIEW)
    view[POSE:FOCAL] = camera.cam_from_world[:3].ravel()
    view[FOCAL:CENTRE] = k[0, 0], k[1, 1]
    view[CENTRE:LIMITS] = k[0, 2], k[1, 2]
    view[LIMITS:EYE] = jacobian_limits(camera)
    view[EYE:NEAR] = camera.world_from_cam[:3, 3]
    view[NEAR] = near_m
    return view


@dataclass(frozen=True)
class _Lists:
    """The splats of V views and the tiles that they reach."""

    splats: np.ndarray
    """Float32, shape [V, N, SPLAT]."""
    boxes: np.ndarray
    """Pixels that each splat can reach, int32, shape [V, N, 4]."""
    tiles_x: int
    splat_starts: np.ndarray
    """First intersection of each splat in the order of the splats, int64, shape [V * N + 1]."""
    tile_starts: np.ndarray
    """First intersection of each tile, int64, shape [V, tiles]."""
    tile_counts: np.ndarray
    by_tile: np.ndarray
    """Splat of each intersection, by tile and depth, int32."""
    by_splat: np.ndarray
    """Position of the same intersections in the order of the splats, int32."""


def _list_splats(arrays: list[np.ndarray], views: np.ndarray, width: int, height: int) -> _Lists:
    """Project, colour, sort and list the Gaussians of [means, quats, scales, opacities, sh]."""
    means, quats, scales, opacities, sh = arrays
    count = len(means)
    splats = np.empty((len(views), count, SPLAT), np.float32)
    boxes = np.empty((len(views), count, 4), np.int32)
    depths = np.empty((len(views), count))
    splat_starts = np.zeros(len(views) * count + 1, np.int64)
    splat_counts = splat_starts[1:].reshape(len(views), count)
    out = (splats, boxes, depths, splat_counts)
    run_parallel([(project_forward, (means, quats, scales, opacities, sh, views, width, height, *out))])

    np.cumsum(splat_starts, out=splat_starts)
    tiles_x, tiles_y = -(-width // TILE_WIDTH), -(-height // TILE_HEIGHT)
    tile_starts, tile_counts = np.empty((2, len(views), tiles_x * tiles_y), np.int64)
    by_tile, by_splat = np.empty((2, int(splat_starts[-1])), np.int32)
    listed = (tile_starts, tile_counts, by_tile, by_splat)
    run_parallel([(list_intersections, (depths, boxes, tiles_x, splat_starts, *listed))], parts=len(views))
    return _Lists(splats, boxes, tiles_x, splat_starts, *listed)


def _stacked(images: Sequence[Tensor]) -> np.ndarray:
    """Return images [H, W, ...] as one array [V, H, W, ...]; a single one is not copied."""
    return array_of(images[0])[None] if len(images) == 1 else np.stack([image.numpy() for image in images])


class _Rasterize(torch.autograd.Function):
    """Rasterize V views of one size: (fields, packed views, width, height) -> rgb, depth, alpha of each view in turn.

    Buffers are numpy's: torch would fill the larger ones on several threads, which takes longer.
    """

    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        sh: Tensor,
        views: np.ndarray,
        width: int,
        height: int,
    ) -> tuple[Tensor, ...]:
        """Render; store the values that the gradient needs."""
        fields = [field.contiguous() for field in (means, quats, scales, opacities, sh)]
        lists = _list_splats([field.detach().numpy() for field in fields], views, width, height)
        shape = (len(views), height, width)
        rgb = np.empty((*shape, 3), np.float32)
        depth, alpha, left, stop = (np.empty(shape, np.float32) for _ in range(4))
        tiles = (lists.tile_starts, lists.tile_counts, lists.by_tile, lists.tiles_x)
        run_parallel([(blend_forward, (lists.splats, lists.boxes, *tiles, rgb, depth, alpha, left, stop))])
        ctx.save_for_backward(*fields)
        ctx.kept = (views, lists, depth.copy(), alpha.copy(), left, stop)
        return tuple(torch.from_numpy(image[v]) for v in range(len(views)) for image in (rgb, depth, alpha))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor | None, ...]:
        """Propagate the gradient of the images back to the Gaussians."""
        fields = [field.detach().numpy() for field in ctx.saved_tensors]
        views, lists, *images = ctx.kept
        splats, boxes = lists.splats, lists.boxes
        partial = np.empty((len(lists.by_tile), LANES), np.float32)
        d_images = [_stacked(upstream[kind::3]) for kind in range(3)]
        tiles = (lists.tile_starts, lists.tile_counts, lists.by_tile, lists.by_splat, lists.tiles_x)
        run_parallel([(blend_backward, (splats, boxes, *tiles, *images, *d_images, partial))])

        summed = (lists.splat_starts, partial, np.empty((*boxes.shape[:2], LANES), np.float32))
        grads = [np.zeros_like(field) for field in fields]
        run_parallel([(project_backward, (*fields, views, splats, boxes, *summed, *grads))])
        return (*(torch.from_numpy(grad) for grad in grads), None, None, None)
