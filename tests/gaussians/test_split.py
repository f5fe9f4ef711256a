import pytest
import torch
from torch.testing import assert_close

from plop.gaussians.split import split, split_at
from tests.gaussians.clouds import random_gaussians


def halves_of(split_set, parents, row):
    return split_set.select(torch.nonzero(parents == row).squeeze(1))


def test_moments_keep_mean_and_covariance_of_every_pair():
    blob = random_gaussians(100, dtype=torch.float64).with_(opacities=torch.full((100,), 0.4, dtype=torch.float64))
    result, parents = split(blob, 3.0, generator=torch.Generator().manual_seed(0))
    rows = parents[100:]
    assert len(rows) > 10
    for row in rows:
        pair = halves_of(result, parents, row)
        assert_close(pair.means.mean(0), blob.means[row])
        offset = pair.means - blob.means[row]
        spread = (pair.covariances + offset[:, :, None] * offset[:, None, :]).mean(0)
        assert_close(spread, blob.covariances[row], rtol=1e-7, atol=1e-12)


def test_moments_keep_the_integral_of_opacity():
    blob = random_gaussians(100, dtype=torch.float64).with_(opacities=torch.full((100,), 0.4, dtype=torch.float64))
    result, _ = split(blob, 3.0)
    assert len(result) > 100

    def mass(gaussians):
        return (gaussians.opacities * gaussians.scales.prod(1)).sum()

    assert_close(mass(result), mass(blob))


def test_paper_is_eq_28_as_printed():
    blob = random_gaussians(1, dtype=torch.float64)
    v = torch.tensor([0.3], dtype=torch.float64)
    result, parents = split_at(blob, torch.tensor([0]), v, form="paper")
    direction = torch.linalg.eigh(blob.covariances[0]).eigenvectors[:, -1]
    gap = (result.means[0] - result.means[1]) / 2
    assert_close(gap.abs(), 0.3 * direction.abs(), rtol=1e-6, atol=1e-9)
    assert_close(result.covariances, (1 - 0.09) * blob.covariances.expand(2, 3, 3), rtol=1e-7, atol=1e-14)
    assert_close(result.opacities, blob.opacities.expand(2) / 2)
    assert parents.tolist() == [0, 0]


def test_order_lineage_and_what_is_not_split():
    blob = random_gaussians(50)
    result, parents = split(blob, 4.0, generator=torch.Generator().manual_seed(1))
    assert torch.equal(parents[:50], torch.arange(50))
    assert torch.equal(result.ids, blob.ids[parents])
    ratio = blob.scales.amax(1) / blob.scales.amin(1)
    assert set(parents[50:].tolist()) == set(torch.nonzero(ratio > 4.0).squeeze(1).tolist())
    same = ratio <= 4.0
    assert torch.equal(result.means[:50][same], blob.means[same])


def test_max_count_takes_the_most_elongated():
    blob = random_gaussians(50)
    result, parents = split(blob, 1.5, max_count=53)
    ratio = blob.scales.amax(1) / blob.scales.amin(1)
    assert len(result) == 53
    assert set(parents[50:].tolist()) == set(ratio.topk(3).indices.tolist())
    assert len(split(blob, 1.5, max_count=10)[0]) == 50


def test_a_seeded_generator_repeats_and_faint_ones_stay_whole():
    blob = random_gaussians(50)
    first, second = (split(blob, 3.0, generator=torch.Generator().manual_seed(5))[0] for _ in range(2))
    assert torch.equal(first.means, second.means)
    assert len(split(blob, 3.0, opacity_above=1.0)[0]) == 50


@pytest.mark.parametrize("form", ["moments", "paper"])
def test_gradients_reach_every_field(form):
    blob = random_gaussians(10, dtype=torch.float64)
    rows, v = torch.arange(4), torch.full((4,), 0.7, dtype=torch.float64)

    def fields(means, scales, opacities, quats):
        given = blob.with_(means=means, scales=scales, opacities=0.3 * opacities, quats=quats)
        result, _ = split_at(given, rows, v, form=form)
        return result.means, result.scales, result.opacities

    leaves = [getattr(blob, name).clone().requires_grad_() for name in ("means", "scales", "opacities", "quats")]
    assert torch.autograd.gradcheck(fields, leaves)
