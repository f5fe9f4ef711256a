"""CD, EMD and HD: hand-computed cases, second implementations, laws of the sampling."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist, directed_hausdorff
from scipy.stats import wasserstein_distance
from skimage.metrics import hausdorff_distance

from plop.geometry.cameras import Camera, look_at
from plop.geometry.view import MaskLabel, View
from plop.metrics.chamfer import cd_mm, cd_sq_mm2, nearest_distances
from plop.metrics.clouds import Cloud, back_project_all, paired_samples
from plop.metrics.emd import emd_mm
from plop.metrics.hausdorff import hd_mm

RNG = np.random.default_rng(3)
CLOUD_A, CLOUD_B = RNG.normal(size=(200, 3)) * 0.02, RNG.normal(size=(150, 3)) * 0.02 + 0.01


def test_two_points_by_hand():
    a, b = np.zeros((1, 3)), np.array([[0.003, 0, 0], [0.0, 0.004, 0]])
    found = nearest_distances(a, b)
    assert cd_mm(found) == pytest.approx(0.5 * (3 + 3.5))
    assert cd_sq_mm2(found) == pytest.approx(0.5 * (9 + 12.5))
    assert hd_mm(found) == pytest.approx(4)


def test_chamfer_and_hausdorff_against_the_full_distance_matrix():
    table = cdist(CLOUD_A, CLOUD_B) * 1000
    found = nearest_distances(CLOUD_A, CLOUD_B)
    assert cd_mm(found) == pytest.approx(0.5 * (table.min(1).mean() + table.min(0).mean()))
    assert cd_sq_mm2(found) == pytest.approx(0.5 * ((table.min(1) ** 2).mean() + (table.min(0) ** 2).mean()))
    both_ways = max(directed_hausdorff(CLOUD_A, CLOUD_B)[0], directed_hausdorff(CLOUD_B, CLOUD_A)[0])
    assert hd_mm(found) == pytest.approx(1000 * both_ways)


def test_hausdorff_against_scikit_image():
    a, b = np.zeros((30, 30), bool), np.zeros((30, 30), bool)
    a[3:9, 4:12], b[10:20, 11:25] = True, True
    in_metres = [np.pad(np.argwhere(image), ((0, 0), (0, 1))) / 1000 for image in (a, b)]
    assert hd_mm(nearest_distances(*in_metres)) == pytest.approx(hausdorff_distance(a, b))


def test_emd_by_hand_needs_the_crossed_matching():
    a = np.array([[0.0, 0, 0], [0.010, 0, 0]])
    b = np.array([[0.011, 0, 0], [0.001, 0, 0]])
    assert emd_mm(a, b) == pytest.approx(1.0)


def test_emd_on_a_line_against_scipy_wasserstein():
    a, b = RNG.normal(size=300), RNG.normal(size=300) + 0.5
    lift = np.zeros((300, 2))
    found = emd_mm(np.column_stack([a, lift]), np.column_stack([b, lift]))
    assert found == pytest.approx(1000 * wasserstein_distance(a, b))


def test_emd_of_a_shift_is_the_shift():
    assert emd_mm(CLOUD_A, CLOUD_A[::-1] + [0.002, 0, 0]) == pytest.approx(2.0)


def test_empty_clouds_are_undefined_and_sizes_are_checked():
    nothing = np.zeros((0, 3))
    found = nearest_distances(nothing, CLOUD_A)
    assert (cd_mm(found), cd_sq_mm2(found), hd_mm(found), emd_mm(nothing, nothing)) == (None,) * 4
    with pytest.raises(ValueError, match="equal size"):
        emd_mm(CLOUD_A, CLOUD_B)


def plane_view(distance_m: float) -> View:
    pose = look_at(np.array([0.0, 0, 0.5]), np.zeros(3), np.array([0.0, 1, 0]))
    camera = Camera("top", 40, 40, np.array([[80.0, 0, 20], [0, 80, 20], [0, 0, 1]]), pose)
    mask = np.full((40, 40), MaskLabel.OBJECT, np.uint8)
    return View(camera, np.zeros((40, 40, 3), np.uint8), np.full((40, 40), distance_m), mask)


def test_back_projection_of_a_plane_lies_on_the_plane_and_skips_unmeasured_pixels():
    view = plane_view(0.5)
    view.depth_m[0, 0], view.depth_m[1, 1] = 0, np.nan
    cloud = back_project_all([view])
    assert len(cloud) == 1598
    assert np.abs(cloud.points[:, 2]).max() < 1e-12
    assert np.abs(cloud.points[:, :2]).max() == pytest.approx(19.5 / 80 * 0.5)


def test_common_random_numbers_give_zero_for_equal_clouds_where_independent_draws_do_not():
    cloud, other = (back_project_all([plane_view(0.5)], seed=seed) for seed in (0, 1))
    assert emd_mm(*paired_samples(cloud, cloud, 300)) == 0
    assert emd_mm(*paired_samples(cloud, other, 300)) > 1


def test_one_missing_pixel_changes_at_most_one_point_of_the_sample():
    view, known = plane_view(0.5), np.ones((40, 40), bool)
    full = back_project_all([view])
    known[20, 20] = False
    less = back_project_all([view], [known])
    a, b = paired_samples(full, less, 300)
    assert len({tuple(p) for p in a} ^ {tuple(p) for p in b}) <= 2


def test_a_sample_is_uniform_over_its_cloud():
    half = np.arange(2000) < 500
    shares = []
    for seed in range(40):
        priority = np.random.default_rng(seed).random(2000)
        sample, _ = paired_samples(*[Cloud(np.repeat(half[:, None], 3, 1).astype(float), priority)] * 2, 200)
        shares.append(sample[:, 0].mean())
    assert np.mean(shares) == pytest.approx(0.25, abs=0.02)


def test_samples_shrink_to_the_smaller_cloud():
    small = Cloud(CLOUD_A[:10], np.arange(10) / 10)
    a, b = paired_samples(small, Cloud(CLOUD_B, np.arange(150) / 150), 64)
    assert len(a) == len(b) == 10
