"""All scores of one frame: what was predicted against what was measured, all cameras together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from plop.geometry.view import MaskLabel, View
from plop.metrics.chamfer import cd_mm, cd_sq_mm2, nearest_distances
from plop.metrics.clouds import back_project_all, paired_samples
from plop.metrics.crop import union_box
from plop.metrics.emd import EMD_POINTS, emd_mm
from plop.metrics.hausdorff import hd_mm
from plop.metrics.masks import f_score, j_score
from plop.metrics.psnr import psnr_db
from plop.metrics.ssim import WINDOW_PX, ssim

CONVENTIONS = {
    "cd_mm": "Chamfer distance [mm]: mean nearest distance, mean of both directions, not squared; all object pixels "
    "of all cameras, back-projected",
    "cd_sq_mm2": "Chamfer distance [mm^2]: mean squared nearest distance, mean of both directions; same clouds",
    "emd_mm": f"earth mover's distance [mm]: mean matched distance, exact matching of {EMD_POINTS} pixels a cloud, "
    "drawn with common random numbers; same clouds",
    "hd_mm": "Hausdorff distance [mm]: largest nearest distance of both directions; same clouds",
    "ssim": "structural similarity [-] on the crop, 11 px Gaussian window, mean over cameras",
    "psnr_db": "peak signal-to-noise ratio [dB] on the crop, images in 0..1, at most 100, mean over cameras",
    "lpips": "learned perceptual distance [-] on the crop, mean over cameras",
    "j_score": "intersection over union of the object's masks [-], mean over cameras",
    "f_score": "boundary F-measure of the object's masks [-], tolerance 0.8 % of the image diagonal, mean over cameras",
    "truth_rms_mm": "root mean square distance [mm] of the simulator's true nodes to where the prediction carries them",
}
"""Definition of each score; stored in every file of scores."""

HIGHER_IS_BETTER = frozenset({"ssim", "psnr_db", "j_score", "f_score"})

Scores = dict[str, float | None]
"""Scores by name; None is undefined (an empty mask or cloud), never 0."""

PerceptualScore = Callable[[np.ndarray, np.ndarray], float]


@dataclass(frozen=True)
class FrameOptions:
    """What to compute for a frame."""

    seed: int = 0
    """Seed of the EMD samples."""
    emd: bool = True
    """Compute EMD, by far the slowest score."""
    lpips: PerceptualScore | None = None
    """The loaded LPIPS; None when unavailable."""


def score_frame(predicted: Sequence[View], measured: Sequence[View], options: FrameOptions) -> Scores:
    """Score one frame.

    Args:
        predicted: Rendered views, one per camera.
        measured: The recording's views of the same cameras in the same order.
        options: What to compute.

    Returns:
        Every score of `CONVENTIONS` except truth_rms_mm.
    """
    known = [view.mask != MaskLabel.UNKNOWN for view in measured]
    scores = _cloud_scores(predicted, measured, known, options)
    per_camera = [_image_scores(*views, options) for views in zip(predicted, measured, known, strict=True)]
    for name in ("ssim", "psnr_db", "lpips", "j_score", "f_score"):
        scores[name] = mean_defined([camera[name] for camera in per_camera])
    return scores


def composite_over_black(view: View, known: np.ndarray | None = None) -> np.ndarray:
    """Keep object and tool as the view's own mask shows them, black elsewhere: the same background for all.

    Args:
        view: Measured or predicted view.
        known: Pixels that count, bool, shape [H, W]; all when absent.

    Returns:
        Image, float32, shape [H, W, 3], 0..1.
    """
    shown = view.object_mask | view.tool_mask
    if known is not None:
        shown = shown & known
    return np.where(shown[..., None], view.rgb.astype(np.float32) / 255, np.float32(0))


def mean_defined(values: Sequence[float | None]) -> float | None:
    """Average the defined values; None when there is none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _cloud_scores(
    predicted: Sequence[View], measured: Sequence[View], known: list[np.ndarray], options: FrameOptions
) -> Scores:
    ours, theirs = (back_project_all(views, known, seed=options.seed) for views in (predicted, measured))
    distances = nearest_distances(ours.points, theirs.points)
    emd = emd_mm(*paired_samples(ours, theirs, EMD_POINTS)) if options.emd else None
    return {"cd_mm": cd_mm(distances), "cd_sq_mm2": cd_sq_mm2(distances), "emd_mm": emd, "hd_mm": hd_mm(distances)}


def _image_scores(predicted: View, measured: View, known: np.ndarray, options: FrameOptions) -> Scores:
    ours, theirs = predicted.object_mask & known, measured.object_mask
    box = union_box(ours, theirs, min_side_px=WINDOW_PX) if theirs.any() else None
    scores: Scores = {"j_score": j_score(ours, theirs), "f_score": f_score(ours, theirs)}
    if box is None:
        return scores | {"ssim": None, "psnr_db": None, "lpips": None}
    image, reference = (composite_over_black(view, known)[box] for view in (predicted, measured))
    lpips = options.lpips(image, reference) if options.lpips else None
    return scores | {"ssim": ssim(image, reference), "psnr_db": psnr_db(image, reference), "lpips": lpips}
