"""All scores of a frame: perfect, shifted, unknown and empty."""

import numpy as np
import pytest

from plop.geometry.cameras import Camera, look_at
from plop.geometry.view import MaskLabel, View
from plop.metrics.frame import CONVENTIONS, FrameOptions, composite_over_black, score_frame

CAMERA = Camera(
    "c",
    40,
    40,
    np.array([[100.0, 0, 20], [0, 100, 20], [0, 0, 1]]),
    look_at(np.array([0.0, 0, 0.4]), np.zeros(3), np.array([0.0, 1, 0])),
)


def view(columns: slice, depth_m: float = 0.4, seed: int = 0) -> View:
    mask = np.zeros((40, 40), np.uint8)
    mask[10:30, columns] = MaskLabel.OBJECT
    rgb = np.random.default_rng(seed).integers(1, 255, (40, 40, 3)).astype(np.uint8)
    return View(CAMERA, rgb, np.full((40, 40), depth_m, np.float32), mask)


def black_outside(shown: View) -> View:
    rgb = (composite_over_black(shown) * 255).round().astype(np.uint8)
    return View(shown.camera, rgb, shown.depth_m, shown.mask)


def test_a_perfect_prediction_has_perfect_scores():
    measured = view(slice(5, 25))
    scores = score_frame([black_outside(measured)], [measured], FrameOptions())
    assert scores.keys() == CONVENTIONS.keys() - {"truth_rms_mm"}
    assert [scores[name] for name in ("cd_mm", "cd_sq_mm2", "emd_mm", "hd_mm")] == [0, 0, 0, 0]
    assert [scores[name] for name in ("ssim", "psnr_db", "j_score", "f_score")] == pytest.approx([1, 100, 1, 1])
    assert scores["lpips"] is None


def test_depth_that_is_off_by_3_mm_costs_about_3_mm():
    measured = view(slice(5, 25))
    scores = score_frame([view(slice(5, 25), depth_m=0.403)], [measured], FrameOptions())
    # Neighbouring pixels are 4 mm apart, so nearest and matched points are those of the same pixel.
    assert scores["cd_mm"] == pytest.approx(3, rel=0.05)
    assert scores["emd_mm"] == pytest.approx(3, rel=0.05)


def test_the_background_of_the_measurement_does_not_count():
    measured = view(slice(5, 25))
    elsewhere = View(
        CAMERA,
        np.where(measured.object_mask[..., None], measured.rgb, 200).astype(np.uint8),
        measured.depth_m,
        measured.mask,
    )
    predicted = black_outside(measured)
    assert score_frame([predicted], [elsewhere], FrameOptions()) == score_frame([predicted], [measured], FrameOptions())


def test_unknown_pixels_do_not_count():
    measured = view(slice(5, 25))
    hidden = measured.mask.copy()
    hidden[:, 15:] = MaskLabel.UNKNOWN
    scores = score_frame(
        [black_outside(measured)], [View(CAMERA, measured.rgb, measured.depth_m, hidden)], FrameOptions()
    )
    assert (scores["j_score"], scores["cd_mm"], scores["psnr_db"]) == (1, 0, 100)


def test_an_empty_measured_mask_is_undefined_never_zero():
    measured = View(
        CAMERA, np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40), np.float32), np.zeros((40, 40), np.uint8)
    )
    scores = score_frame([black_outside(view(slice(5, 25)))], [measured], FrameOptions())
    assert set(scores.values()) == {None}


def test_a_camera_that_sees_nothing_is_left_out_of_the_mean():
    measured = view(slice(5, 25))
    blind = View(CAMERA, np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40), np.float32), np.zeros((40, 40), np.uint8))
    both = score_frame([black_outside(measured)] * 2, [measured, blind], FrameOptions())
    assert (both["j_score"], both["psnr_db"]) == (1, 100)


def test_a_vanished_object_scores_zero_on_masks_and_has_no_cloud_score():
    measured = view(slice(5, 25))
    gone = View(CAMERA, np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40), np.float32), np.zeros((40, 40), np.uint8))
    scores = score_frame([gone], [measured], FrameOptions())
    assert (scores["j_score"], scores["f_score"]) == (0, 0)
    assert (scores["cd_mm"], scores["emd_mm"]) == (None, None)
