"""Score a fit on a held-out view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.view import MaskLabel, View
from plop.metrics.psnr import psnr_db
from plop.render.losses import Target, lay_over, target_from_view, target_over_measured
from plop.render.pictures.comparison import compared_views
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.rasterize import render
from stages.fit_init.shell import seen_by

_LEAST_TRAINING = 2
_SEEN_SHARE = 0.02
"""Difference in depth under which two views have measured the same point, as a share of the object's size."""


@dataclass(frozen=True)
class ViewScore:
    """How well a rendering matches one measured view of the object."""

    psnr_db: float
    """PSNR of the rendering over the measured background, inside the bounding box of the object's mask, without
    pixels of the tool or unknown ones [dB]."""
    psnr_black_db: float
    """The same with both over black, the measured one cut out with its hard mask [dB]."""
    depth_error_mm: float | None
    """Mean absolute error where the object's depth was measured and it is rendered (alpha > 0.5) [mm]."""
    coverage: float
    """Share of the object's pixels that are rendered (alpha > 0.5)."""


def check_held_out(count: int, cameras: int, where: str) -> None:
    """Reject more held-out views than are available besides the two training views.

    One is the default and always accepted: where no view can be held out, the score is of a fitted view.

    Args:
        count: Number of held-out views.
        cameras: Cameras of the episode.
        where: Source of these cameras, for the message.

    Raises:
        PlopError: Names the cameras and how many of them can be held out.
    """
    most = max(cameras - _LEAST_TRAINING, 1)
    if count > most:
        raise PlopError(
            "Too many cameras are held out.",
            where=where,
            expected=f"held_out from 0 to {most}: of {cameras} cameras {_LEAST_TRAINING} are needed for training",
            found=f"held_out = {count}",
            fix=f"Choose --held-out {most} or less, or record more cameras.",
        )


def choose_held_out(views: list[View], count: int) -> tuple[list[View], list[View]]:
    """Choose held-out views for the score: those that see the least that no other view sees.

    A held-out view should measure the quality of the fit, not that a side of the object is hidden from all others.
    Views are held out one by one: that with the largest share of points also measured by the remaining ones; at least
    two remain. Without depth the last in order is held out.

    Args:
        views: Measured frames of one instant.
        count: Number of held-out views.

    Returns:
        Training views and held-out views, each in their order.
    """
    training = list(views)
    held: list[View] = []
    while len(held) < count and len(training) > _LEAST_TRAINING:
        seen = [_share_seen(view, [other for other in training if other is not view]) for view in training]
        best = max(range(len(training)), key=lambda index: (seen[index], index))
        held.append(training.pop(best))
    return training, [view for view in views if any(view is other for other in held)]


def _share_seen(view: View, others: list[View]) -> float:
    measured = view.object_mask & (view.depth_m > 0)
    points = view.camera.back_project(view.depth_m, measured)
    if len(points) == 0:
        return 0.0
    tolerance = _SEEN_SHARE * float(np.ptp(points, axis=0).max())
    return float(seen_by(points, others, tolerance).mean())


def score_view(gaussians: Gaussians, view: View) -> tuple[ViewScore, np.ndarray]:
    """Compare one view with its rendering.

    Args:
        gaussians: The fit.
        view: Measured frame that shows the object.

    Returns:
        The score, and the picture measured | predicted | distance, uint8 [H, W, 3].
    """
    with torch.no_grad():
        rendering = render(gaussians, view.camera)
    over_measured, over_black = target_over_measured(view), target_from_view(view)
    shown = _shown(rendering, over_measured)
    coverage = (rendering.alpha[over_black.object_mask] > 0.5).float().mean()
    score = ViewScore(
        psnr_db=_psnr_in_box(shown, over_measured),
        psnr_black_db=_psnr_in_box(_shown(rendering, over_black), over_black),
        depth_error_mm=_depth_error(rendering, over_black),
        coverage=float(coverage),
    )
    rgb = (shown * 255).round().byte().numpy()
    drawn = np.where(rendering.alpha.numpy() > 0.5, np.uint8(MaskLabel.OBJECT), np.uint8(MaskLabel.BACKGROUND))
    return score, compared_views(view, View(view.camera, rgb, rendering.depth_m.numpy(), drawn))


def _shown(rendering: Rendering, target: Target) -> Tensor:
    """Return the rendering over the target's background, equal to the target where that is masked."""
    return torch.where(target.valid[..., None], lay_over(rendering, target), target.rgb).clamp(0, 1)


def _psnr_in_box(image: Tensor, target: Target) -> float:
    rows, columns = torch.nonzero(target.object_mask, as_tuple=True)
    box = (slice(int(rows.min()), int(rows.max()) + 1), slice(int(columns.min()), int(columns.max()) + 1))
    counted = target.valid[box]
    return psnr_db(image[box][counted].numpy(), target.rgb[box][counted].numpy())


def _depth_error(rendering: Rendering, target: Target) -> float | None:
    counted = target.valid & target.object_mask & (target.depth_m > 0) & (rendering.alpha > 0.5)
    if not counted.any():
        return None
    return float((rendering.depth_m - target.depth_m)[counted].abs().mean() * 1000)
