import pytest
import torch
from torch.testing import assert_close

from plop.gaussians.split import split, split_at
from plop.gaussians.state import Gaussians
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


def test_paper_is_eq_28_in_the_parents_own_standard_deviations():
    blob = random_gaussians(1, dtype=torch.float64)
    v = torch.tensor([0.3], dtype=torch.float64)
    result, parents = split_at(blob, torch.tensor([0]), v, form="paper")
    direction = torch.linalg.eigh(blob.covariances[0]).eigenvectors[:, -1]
    gap = (result.means[0] - result.means[1]) / 2
    assert_close(gap.abs(), 0.3 * blob.scales[0].max() * direction.abs(), rtol=1e-6, atol=1e-9)
    assert_close(result.covariances, (1 - 0.09) * blob.covariances.expand(2, 3, 3), rtol=1e-7, atol=1e-14)
    assert_close(result.opacities, blob.opacities.expand(2) / 2)
    assert parents.tolist() == [0, 0]


def needles(count: int) -> Gaussians:
    """Long, thin Gaussians: 100 to 1,000 times as long as thick."""
    blob = random_gaussians(count, dtype=torch.float64)
    thin = torch.tensor([1e-5, 2e-5, 1e-2], dtype=torch.float64)
    return blob.with_(scales=thin * (0.5 + blob.opacities[:, None] * torch.tensor([1.0, 1.0, 1.5])))


@pytest.mark.parametrize("form", ["moments", "paper"])
def test_halves_lie_inside_a_long_thin_parent(form):
    parents = needles(200)
    result, origin = split(parents, 3.0, form=form, generator=torch.Generator().manual_seed(0))
    assert len(result) == 400
    whitened = torch.linalg.solve(parents.covariances[origin], (result.means - parents.means[origin])[..., None])
    inside = ((result.means - parents.means[origin])[:, None] @ whitened).squeeze()
    assert inside.max() <= 1 + 1e-9, "a centre lies more than a standard deviation from the parent's"
    # v + 3 sqrt(1 - v^2) <= sqrt(10): the halves' three standard deviations reach 5 % further than the parent's
    along = (result.means - parents.means[origin]).norm(dim=1) + 3 * result.scales.amax(1)
    assert (along <= 10**0.5 * parents.scales[origin].amax(1) * (1 + 1e-9)).all()


@pytest.mark.parametrize("form", ["moments", "paper"])
def test_descendants_of_many_rounds_stay_about_where_their_ancestor_was(form):
    """Each round keeps the variance along the axis, so that the box, and with it a grid, stays bounded."""
    ancestor = needles(1)
    crowd, generator = ancestor, torch.Generator().manual_seed(3)
    for _ in range(40):
        crowd, _ = split(crowd, 1.0, form=form, generator=generator, max_count=4000)
    assert len(crowd) == 4000
    assert (crowd.means - ancestor.means).norm(dim=1).max() < 5 * ancestor.scales.max()


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
