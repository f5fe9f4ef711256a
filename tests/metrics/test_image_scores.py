"""SSIM, PSNR, J, F and the crop against scikit-image, torchmetrics and hand-computed cases."""

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torchmetrics.functional import jaccard_index
from torchmetrics.functional.image import peak_signal_noise_ratio as torch_psnr
from torchmetrics.functional.image import structural_similarity_index_measure as torch_ssim

from plop.metrics.crop import union_box
from plop.metrics.masks import boundary, f_score, j_score
from plop.metrics.psnr import PERFECT_DB, psnr_db
from plop.metrics.ssim import ssim

RNG = np.random.default_rng(5)
IMAGE = RNG.random((40, 33, 3))
NOISY = np.clip(IMAGE + 0.1 * RNG.normal(size=IMAGE.shape), 0, 1)


def as_batch(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(image).permute(2, 0, 1)[None]


def test_ssim_against_scikit_image_and_torchmetrics():
    oracle = structural_similarity(
        NOISY, IMAGE, data_range=1.0, channel_axis=-1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert ssim(NOISY, IMAGE) == pytest.approx(oracle, abs=1e-9)
    _, everywhere = torch_ssim(as_batch(NOISY), as_batch(IMAGE), data_range=1.0, return_full_image=True)
    inside = everywhere[..., 5:-5, 5:-5]  # torchmetrics also counts windows that cross the border
    assert ssim(NOISY, IMAGE) == pytest.approx(float(inside.mean()), abs=1e-5)


def test_ssim_of_constant_images_by_hand():
    dark, bright = np.full((20, 20, 3), 0.2), np.full((20, 20, 3), 0.6)
    assert ssim(dark, bright) == pytest.approx((2 * 0.12 + 1e-4) / (0.04 + 0.36 + 1e-4))


def test_ssim_is_one_for_equal_images_and_undefined_below_its_window():
    assert ssim(IMAGE, IMAGE) == pytest.approx(1)
    assert ssim(IMAGE[:10], IMAGE[:10]) is None


def test_psnr_against_scikit_image_torchmetrics_and_by_hand():
    assert psnr_db(NOISY, IMAGE) == pytest.approx(peak_signal_noise_ratio(IMAGE, NOISY, data_range=1.0))
    oracle = torch_psnr(as_batch(NOISY), as_batch(IMAGE), data_range=1.0)
    assert psnr_db(NOISY, IMAGE) == pytest.approx(float(oracle), abs=1e-4)
    assert psnr_db(np.full((4, 4, 3), 0.1), np.zeros((4, 4, 3))) == pytest.approx(20)


def test_psnr_of_equal_images_is_the_stated_perfect_score():
    assert psnr_db(IMAGE, IMAGE) == PERFECT_DB


def square(top: int, left: int, side: int = 20) -> np.ndarray:
    mask = np.zeros((64, 64), bool)
    mask[top : top + side, left : left + side] = True
    return mask


def test_j_by_hand_and_against_torchmetrics():
    a, b = square(10, 10), square(10, 20)
    assert j_score(a, b) == pytest.approx(200 / 600)
    oracle = jaccard_index(torch.from_numpy(a).int(), torch.from_numpy(b).int(), task="binary")
    assert j_score(a, b) == pytest.approx(float(oracle))


def test_f_is_one_within_the_tolerance_and_falls_beyond_it():
    # At 64x64 the tolerance is ceil(0.008 * 90.5) = 1 px.
    assert f_score(square(10, 10), square(10, 10)) == 1
    assert f_score(square(10, 11), square(10, 10)) == 1
    far = f_score(square(10, 14), square(10, 10))
    assert 0.3 < far < 0.7  # the two horizontal edges still overlap
    assert f_score(square(40, 40), square(2, 2)) == 0


def test_f_of_a_half_contour_by_hand():
    # Precision 1 and recall r give F = 2 r / (1 + r): two squares far apart, one of them predicted.
    both = square(5, 5) | square(38, 38)
    assert f_score(square(5, 5), both) == pytest.approx(2 / 3)


def test_boundary_by_hand():
    mask = np.zeros((5, 5), bool)
    mask[2, 2] = True
    assert set(map(tuple, np.argwhere(boundary(mask)))) == {(1, 1), (1, 2), (2, 1), (2, 2)}


def test_empty_masks_are_undefined_when_measured_and_zero_when_predicted():
    nothing = np.zeros((64, 64), bool)
    assert j_score(square(5, 5), nothing) is None
    assert f_score(square(5, 5), nothing) is None
    assert j_score(nothing, square(5, 5)) == 0
    assert f_score(nothing, square(5, 5)) == 0


def test_crop_is_the_box_of_the_union():
    rows, columns = union_box(square(10, 12, 5), square(30, 2, 4))
    assert (rows, columns) == (slice(10, 34), slice(2, 17))
    assert union_box(np.zeros((8, 8), bool), np.zeros((8, 8), bool)) is None


@pytest.mark.parametrize("corner", [(0, 0), (63, 63), (30, 0), (0, 63)])
def test_small_crops_are_widened_inside_the_image(corner):
    mask = np.zeros((64, 64), bool)
    mask[corner] = True
    rows, columns = union_box(mask, mask, min_side_px=11)
    for part, at in zip((rows, columns), corner, strict=True):
        assert part.stop - part.start == 11
        assert 0 <= part.start <= at < part.stop <= 64


def test_crop_cannot_grow_beyond_the_image():
    mask = np.ones((6, 6), bool)
    assert union_box(mask, mask, min_side_px=11) == (slice(0, 6), slice(0, 6))
