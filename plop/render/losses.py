"""Targets of renderings, and the loss between them (PLOP, Eq. 8-10)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
import torch
from scipy.ndimage import binary_dilation, distance_transform_edt
from torch import Tensor

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.render.rasterizer.interface import Rendering
from plop.setting_kinds import COMMON, Formerly, Range, Settings, Unit, Weight

SSIM_WINDOW = 11
"""Edge of the Gaussian window [px]."""
SSIM_SIGMA = 1.5
"""Its standard deviation [px]."""


@dataclass(frozen=True)
class RenderWeights(Settings):
    """Weights of the rendering loss; their defaults are defined only here."""

    ssim: Annotated[Weight, Formerly("ssim_weight")] = 0.1
    """Weight of 1 - SSIM."""
    l1: Annotated[Weight, Formerly("l1_weight")] = 0.9
    """Weight of the mean absolute colour error, colours 0..1."""
    depth: Annotated[Weight, COMMON, Formerly("depth_weight")] = 0.2
    """Weight of the mean absolute depth error, counted in `render.depth_unit_m`."""
    mask: Annotated[Weight, COMMON, Formerly("mask_weight")] = 0.1
    """Weight of the mean absolute error of alpha against the object's mask; 0 in the paper."""
    depth_unit_m: Annotated[float, Range(1e-6, 1e6), Unit("m"), Formerly("length_unit_m")] = 0.1
    """Unit of depth errors and of other lengths in a loss; with `fit-init.scene_size` that of the scene instead. For a
    scene of 0.1 m depth and colour have equal weight."""

    def in_scene_units(self, scale: float) -> RenderWeights:
        """Return the same weights with lengths in scene units, of which there are `scale` in a metre."""
        return replace(self, depth_unit_m=1 / scale)


@dataclass(frozen=True)
class Target:
    """A measured view, prepared for comparison with renderings of the object."""

    camera: Camera
    rgb: Tensor
    """Colour of the object over the background that renderings use, shape [H, W, 3], 0..1."""
    depth_m: Tensor
    """Depth along the optical axis, shape [H, W] [m]; 0 where not measured."""
    object_mask: Tensor
    """Pixels that show the object, bool, shape [H, W]."""
    valid: Tensor
    """Pixels that are not masked, bool, shape [H, W]."""
    behind: Tensor | None = None
    """Background to add to a rendering over black, shape [H, W, 3]; None when it has one already."""


def target_from_view(
    view: View, background: Tensor | None = None, *, device: torch.device | str = "cpu", ignore_tool: bool = True
) -> Target:
    """Prepare a view: every pixel that does not show the object takes the background's colour.

    Pixels labelled TOOL and UNKNOWN are masked, since the object may be behind them, as are pixels adjacent to
    the tool, which mix its colour with others.

    Args:
        view: Measured frame of one camera.
        background: Colour behind the rendered object, shape [3], 0..1; black when absent.
        device: Device of the target.
        ignore_tool: Count pixels of the tool as background when False.

    Returns:
        The target.
    """
    mask = torch.from_numpy(view.object_mask)
    behind = torch.zeros(3, device="cpu") if background is None else background.detach().cpu().float()
    rgb = torch.from_numpy(view.rgb.astype(np.float32) / 255)
    depth = torch.from_numpy(np.nan_to_num(view.depth_m, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32))
    ignored = view.mask == MaskLabel.UNKNOWN
    if ignore_tool:
        ignored = ignored | binary_dilation(view.tool_mask)
    target = (torch.where(mask[..., None], rgb, behind), depth.clamp_min(0), mask, torch.from_numpy(~ignored))
    return Target(view.camera, *(tensor.to(device) for tensor in target))


def target_over_measured(view: View, *, device: torch.device | str = "cpu") -> Target:
    """Prepare a view with its own background for renderings of the object.

    A pixel on the outline mixes object and background. Over the measured background a soft outline
    can match it; over a plain colour (`target_from_view`) only a hard and jagged one can. The background
    at and near the object is that of the nearest pixel at least 2 px away from object and tool.

    Args:
        view: Measured frame of one camera.
        device: Where the target lives.

    Returns:
        The target, for renderings over black; that of `target_from_view` where no pure background is visible.
    """
    pure = ~binary_dilation(view.mask != MaskLabel.BACKGROUND, iterations=2)
    target = target_from_view(view)
    if pure.any():
        rows, columns = distance_transform_edt(~pure, return_distances=False, return_indices=True)
        rgb = torch.from_numpy(view.rgb.astype(np.float32) / 255)
        target = replace(target, rgb=rgb, behind=rgb[torch.from_numpy(rows).long(), torch.from_numpy(columns).long()])
    moved: dict[str, Any] = {name: part.to(device) for name, part in vars(target).items() if isinstance(part, Tensor)}
    return replace(target, **moved)


def lay_over(rendering: Rendering, target: Target) -> Tensor:
    """Return a rendering's colours over the target's background, shape [H, W, 3]."""
    if target.behind is None:
        return rendering.rgb
    return rendering.rgb + (1 - rendering.alpha)[..., None] * target.behind


def render_loss(
    rendering: Rendering, target: Target, weights: RenderWeights | None = None
) -> tuple[Tensor, dict[str, Tensor]]:
    """Compare a rendering with a measured view.

    ssim (1 - SSIM) + l1 |rgb| + depth |depth| / depth_unit_m + mask |alpha - mask|, each a mean.
    Masked pixels get the target's colour before SSIM. Depth is compared on the object where it
    was measured, each pixel with its rendered alpha as a constant weight, so that thin spots have no influence.

    Args:
        rendering: View of the object over the background that the target was made with.
        target: Measured view of the same size.
        weights: Defaults of `RenderWeights` when absent.

    Returns:
        The loss, a scalar with gradient, and its detached terms "l1", "ssim" (1 - SSIM), "depth_m", "mask".
    """
    weights = weights or RenderWeights()
    valid = target.valid
    counted = valid.sum().clamp_min(1)
    rgb = torch.where(valid[..., None], lay_over(rendering, target), target.rgb)
    terms = {"l1": (rgb - target.rgb).abs().sum() / (3 * counted)}
    terms["ssim"] = 1 - _ssim_where_different(rgb, target.rgb)
    measured = valid & target.object_mask & (target.depth_m > 0)
    certainty = rendering.alpha.detach() * measured
    depth_error = (torch.where(measured, rendering.depth_m, target.depth_m) - target.depth_m).abs()
    terms["depth_m"] = (certainty * depth_error).sum() / certainty.sum().clamp_min(1)
    alpha_error = (rendering.alpha - target.object_mask.to(rendering.alpha)).abs()
    terms["mask"] = (alpha_error * valid).sum() / counted
    loss = weights.l1 * terms["l1"] + weights.ssim * terms["ssim"]
    loss = loss + weights.depth / weights.depth_unit_m * terms["depth_m"] + weights.mask * terms["mask"]
    return loss, {name: value.detach() for name, value in terms.items()}


def _ssim_where_different(image: Tensor, reference: Tensor) -> Tensor:
    """Compute SSIM of the whole image from the part that differs; elsewhere it is 1."""
    height, width = image.shape[:2]
    shown = (image.detach() != reference).any(-1)
    box, windows = [], 1
    for lines, length in ((shown.any(1), height), (shown.any(0), width)):
        used = torch.nonzero(lines).squeeze(1)
        if len(used) == 0:
            return image.new_ones(())
        low = max(int(used[0]) - SSIM_WINDOW + 1, 0)
        high = min(int(used[-1]) + SSIM_WINDOW, length)
        box.append(slice(low, high))
        windows *= max(high - low - SSIM_WINDOW + 1, 0)
    everywhere = max(height - SSIM_WINDOW + 1, 0) * max(width - SSIM_WINDOW + 1, 0)
    share = windows / max(everywhere, 1)
    return 1 - share * (1 - ssim(image[tuple(box)], reference[tuple(box)]))


def ssim(image: Tensor, reference: Tensor) -> Tensor:
    """Measure structural similarity, averaged over channels and over the pixels whose window fits inside.

    Args:
        image: Shape [H, W, C], 0..1.
        reference: Same shape.

    Returns:
        Mean similarity, a scalar at most 1, differentiable in both. 1 for images smaller than the window.

    Source: Wang et al. 2004, with a Gaussian window of 11 px and sigma 1.5 px, as in 3D Gaussian splatting.
    """
    height, width = image.shape[:2]
    if min(height, width) < SSIM_WINDOW:
        return image.new_ones(())
    x, y = image.permute(2, 0, 1), reference.permute(2, 0, 1)
    # Blurring as two products with banded matrices: on a CPU faster than small convolutions.
    rows, columns = _blur_matrix(height).to(x), _blur_matrix(width).to(x)
    mean_x, xx, xy = (rows @ torch.stack([x, x * x, x * y]) @ columns.T).unbind(0)
    mean_y, yy = (rows @ torch.stack([y, y * y]) @ columns.T).unbind(0)
    c1, c2 = 0.01**2, 0.03**2
    product, squares = mean_x * mean_y, mean_x.square() + mean_y.square()
    above = (2 * product + c1) * (2 * (xy - product) + c2)
    return (above / ((squares + c1) * (xx + yy - squares + c2))).mean()


@lru_cache(maxsize=16)
def _blur_matrix(length: int) -> Tensor:
    """Build the matrix that blurs a line of pixels, shape [length - 10, length]."""
    offset = torch.arange(SSIM_WINDOW, dtype=torch.float64, device="cpu") - SSIM_WINDOW // 2
    window = torch.exp(-0.5 * (offset / SSIM_SIGMA).square())
    window = (window / window.sum()).float()
    matrix = window.new_zeros(length - SSIM_WINDOW + 1, length)
    for row in range(len(matrix)):
        matrix[row, row : row + SSIM_WINDOW] = window
    return matrix


def anisotropy_hinge(gaussians: Gaussians, ratio: float) -> Tensor:
    """Penalise stretched Gaussians: mean of max(longest / shortest scale, r) - r.

    Args:
        gaussians: N Gaussians.
        ratio: Elongation r without a penalty [-].

    Returns:
        Scalar >= 0.

    Source: PLOP, Eq. 10.
    """
    if len(gaussians) == 0:
        return gaussians.scales.new_zeros(())
    stretch = gaussians.scales.amax(1) / gaussians.scales.amin(1).clamp_min(1e-9)
    return (stretch - ratio).clamp_min(0).mean()
