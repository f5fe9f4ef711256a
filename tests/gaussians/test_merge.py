import pytest
import torch
from torch.testing import assert_close

from plop.gaussians.merge import MAX_OPACITY, merge
from plop.gaussians.state import Gaussians, concatenate
from tests.gaussians.clouds import random_gaussians, total_moments


@pytest.fixture
def faint():
    """200 Gaussians of which about half are below 0.01; no sum reaches 1."""
    blob = random_gaussians(200, dtype=torch.float64)
    return blob.with_(opacities=0.02 * blob.opacities)


def test_moments_keep_weight_mean_and_covariance_with_many_into_one(faint):
    merged, kept = merge(faint, 0.015)
    assert len(merged) < len(faint) / 2, "the case must send several into one survivor"
    for ours, theirs in zip(total_moments(merged), total_moments(faint), strict=True):
        assert_close(ours, theirs, rtol=1e-9, atol=1e-15)
    assert_close(merged.ids, faint.ids[kept])


def test_paper_is_eq_27_applied_one_after_the_other(faint):
    merged, kept = merge(faint, 0.01, form="paper")
    low = faint.opacities < 0.01
    weight, mean, spread = faint.opacities.clone(), faint.means.clone(), faint.covariances.clone()
    survivors = torch.nonzero(~low).squeeze(1)
    for i in torch.nonzero(low).squeeze(1):
        j = survivors[(faint.means[survivors] - faint.means[i]).norm(dim=1).argmin()]
        total = weight[i] + weight[j]
        mean[j] = (weight[i] * mean[i] + weight[j] * mean[j]) / total
        spread[j] = (weight[i] * spread[i] + weight[j] * spread[j]) / total
        weight[j] = total
    assert_close(merged.means, mean[kept])
    assert_close(merged.opacities, weight[kept])
    assert_close(merged.covariances, spread[kept], rtol=1e-8, atol=1e-14)


def test_the_spread_between_two_means_is_what_paper_leaves_out():
    pair = random_gaussians(2).with_(opacities=torch.tensor([0.04, 0.5]))
    ours, _ = merge(pair, 0.05)
    printed, _ = merge(pair, 0.05, form="paper")
    share = pair.opacities / pair.opacities.sum()
    gap = pair.means[0] - pair.means[1]
    missing = share.prod() * gap[:, None] * gap[None, :]
    assert_close(ours.covariances[0] - printed.covariances[0], missing, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("form", ["moments", "paper"])
def test_opacity_stays_below_one(form):
    crowd = random_gaussians(10).with_(opacities=torch.tensor([0.95] + [0.04] * 9))
    assert merge(crowd, 0.05, form=form)[0].opacities.item() == pytest.approx(MAX_OPACITY)


def test_a_survivor_that_absorbs_nothing_is_untouched():
    near, far = random_gaussians(5), random_gaussians(1, seed=3)
    blob = concatenate(
        [
            near.with_(opacities=torch.tensor([0.9, 0.01, 0.01, 0.01, 0.01])),
            far.with_(means=far.means + 5, opacities=torch.tensor([0.9])),
        ]
    )
    merged, kept = merge(blob, 0.05)
    assert kept.tolist() == [0, 5]
    for name in ("means", "quats", "scales", "opacities", "sh", "ids"):
        assert torch.equal(getattr(merged, name)[1], getattr(blob, name)[5])


@pytest.mark.parametrize("below", [0.0, 2.0])
def test_nothing_happens_when_none_or_all_are_below(below):
    blob = random_gaussians(6)
    merged, kept = merge(blob, below)
    assert merged is blob and kept.tolist() == list(range(6))


def test_gradients_reach_absorbed_and_surviving():
    blob = random_gaussians(20, dtype=torch.float64)
    leaves = [getattr(blob, name).clone().requires_grad_() for name in ("means", "opacities", "scales", "sh")]

    def moments(means, opacities, scales, sh):
        given = Gaussians(means, blob.quats, scales, opacities, sh, blob.ids)
        merged, _ = merge(given, 0.3)
        return merged.means, merged.opacities, merged.scales, merged.sh

    gradients = torch.autograd.grad(sum(part.square().sum() for part in moments(*leaves)), leaves)
    low = blob.opacities < 0.3
    assert low.any()
    for gradient in gradients:
        assert torch.isfinite(gradient).all()
        assert (gradient[low].abs().reshape(int(low.sum()), -1).sum(1) > 0).all()
    assert torch.autograd.gradcheck(lambda m, o: moments(m, o, leaves[2], leaves[3])[0], leaves[:2])
