import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from torch.testing import assert_close

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.render.losses import (
    RenderWeights,
    anisotropy_hinge,
    lay_over,
    render_loss,
    ssim,
    target_from_view,
    target_over_measured,
)
from plop.render.rasterizer.interface import Rendering

SIZE = 40


def a_view(*, depth: float = 0.3) -> View:
    """An object in the middle, a tool left of it, one undecided pixel."""
    mask = np.zeros((SIZE, SIZE), np.uint8)
    mask[10:30, 12:32] = MaskLabel.OBJECT
    mask[5:35, 8:12] = MaskLabel.TOOL
    mask[20, 20] = MaskLabel.UNKNOWN
    rgb = np.random.default_rng(0).integers(0, 255, (SIZE, SIZE, 3)).astype(np.uint8)
    camera = Camera("cam", SIZE, SIZE, np.diag([50.0, 50.0, 1.0]), np.eye(4))
    return View(camera, rgb, np.full((SIZE, SIZE), depth, np.float32), mask)


def perfect(target) -> Rendering:
    return Rendering(target.rgb.clone(), target.depth_m.clone(), target.object_mask.float())


def test_ssim_is_that_of_scikit_image():
    rng = np.random.default_rng(0)
    image, other = rng.random((50, 37, 3)), rng.random((50, 37, 3))
    other = 0.5 * image + 0.5 * other
    expected = structural_similarity(
        image, other, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert ssim(torch.from_numpy(image), torch.from_numpy(other)).item() == pytest.approx(expected, abs=1e-5)


def test_ssim_gradient():
    generator = torch.Generator().manual_seed(0)
    image, other = torch.rand(2, 13, 12, 1, dtype=torch.float64, generator=generator)
    assert torch.autograd.gradcheck(lambda x: ssim(x, other), image.requires_grad_(), atol=1e-4)


def test_a_perfect_rendering_costs_nothing_and_every_fault_costs_something():
    target = target_from_view(a_view())
    loss, _ = render_loss(perfect(target), target)
    assert loss.item() == pytest.approx(0, abs=1e-6)
    faults = {
        "l1": Rendering(target.rgb * 0.9, target.depth_m, target.object_mask.float()),
        "depth_m": Rendering(target.rgb, target.depth_m + 0.01, target.object_mask.float()),
        "mask": Rendering(target.rgb, target.depth_m, 0.5 * target.object_mask.float()),
    }
    for name, rendering in faults.items():
        loss, terms = render_loss(rendering, target)
        assert loss > 1e-4 and terms[name] > 1e-3, name


def test_the_loss_is_the_weighted_sum_of_its_terms():
    target = target_from_view(a_view())
    generator = torch.Generator().manual_seed(0)
    rendering = Rendering(
        torch.rand(SIZE, SIZE, 3, generator=generator),
        target.depth_m + 0.02,
        torch.rand(SIZE, SIZE, generator=generator),
    )
    weights = RenderWeights(ssim=0.3, l1=0.5, depth=0.7, mask=0.11, depth_unit_m=0.05)
    loss, terms = render_loss(rendering, target, weights)
    expected = 0.3 * terms["ssim"] + 0.5 * terms["l1"] + 0.7 * terms["depth_m"] / 0.05 + 0.11 * terms["mask"]
    assert_close(loss, expected)
    assert terms["depth_m"].item() == pytest.approx(0.02, rel=1e-4)
    valid = target.valid
    image = torch.where(valid[..., None], rendering.rgb, target.rgb)
    assert terms["l1"].item() == pytest.approx((image - target.rgb)[valid].abs().mean().item(), rel=1e-5)
    assert terms["ssim"].item() == pytest.approx(1 - ssim(image, target.rgb).item(), abs=1e-5)


def test_tool_undecided_and_unmeasured_pixels_do_not_count():
    view = a_view()
    view.depth_m[15:20, 15:20] = 0
    view.depth_m[25, 25] = np.nan
    target = target_from_view(view)
    good = perfect(target)
    rgb, depth = good.rgb.clone(), good.depth_m.clone()
    ignored = (view.mask == MaskLabel.TOOL) | (view.mask == MaskLabel.UNKNOWN)
    rgb[torch.from_numpy(ignored)] = 1.0
    depth[15:20, 15:20] = 5.0
    depth[25, 25] = 5.0
    assert render_loss(Rendering(rgb, depth, good.alpha), target)[0].item() == pytest.approx(0, abs=1e-6)
    assert not target_from_view(view).valid[20, 9] and target_from_view(view, ignore_tool=False).valid[20, 9]


def test_background_pixels_take_the_colour_of_the_renderings_background():
    target = target_from_view(a_view(), torch.tensor([0.2, 0.4, 0.6]))
    assert_close(target.rgb[0, 0], torch.tensor([0.2, 0.4, 0.6]))
    assert_close(target.rgb[15, 15] * 255, torch.from_numpy(a_view().rgb[15, 15]).float())


def test_a_soft_outline_matches_over_the_measured_background_only():
    """A pixel that is half object, half background is what a camera sees at an outline."""
    view = a_view()
    view.mask[view.mask != MaskLabel.OBJECT] = 0
    view.rgb[:] = 200
    view.rgb[view.object_mask] = 40
    view.rgb[10, 12:32] = 120
    alpha = torch.from_numpy(view.object_mask).float()
    alpha[10, 12:32] = 0.5
    rendering = Rendering(alpha[..., None] * 40 / 255, torch.from_numpy(view.depth_m), alpha)
    over = target_over_measured(view)
    assert (lay_over(rendering, over) - over.rgb)[9:12].abs().max() < 0.005
    black = target_from_view(view)
    assert (lay_over(rendering, black) - black.rgb)[10].abs().max() > 0.2


def test_measured_background_is_taken_away_from_object_and_tool():
    view = a_view()
    view.rgb[:] = 100
    near = np.zeros_like(view.mask, bool)
    near[8:32, 10:34] = True
    view.rgb[near & (view.mask == 0)] = 250  # mixed pixels beside the object
    target = target_over_measured(view)
    assert_close(target.behind[20, 25] * 255, torch.full((3,), 100.0))


def test_no_background_in_sight_falls_back_to_black():
    view = a_view()
    view.mask[:] = MaskLabel.OBJECT
    assert target_over_measured(view).behind is None


def test_loss_of_an_empty_view_is_finite():
    view = a_view()
    view.mask[:] = MaskLabel.UNKNOWN
    target = target_from_view(view)
    alpha = torch.zeros(SIZE, SIZE, requires_grad=True)
    loss, _ = render_loss(Rendering(alpha[..., None].expand(-1, -1, 3), alpha, alpha), target)
    loss.backward()
    assert loss.item() == pytest.approx(0, abs=1e-6) and torch.isfinite(alpha.grad).all()


def test_anisotropy_is_eq_10():
    scales = torch.tensor([[1.0, 1, 2], [1, 3, 5], [4, 4, 4]])
    blob = Gaussians(torch.zeros(3, 3), torch.zeros(3, 4), scales, torch.ones(3), torch.zeros(3, 1, 3), torch.arange(3))
    assert anisotropy_hinge(blob, 2.5).item() == pytest.approx((0 + 2.5 + 0) / 3)
    assert anisotropy_hinge(blob.select(torch.zeros(0, dtype=torch.int64)), 2.5) == 0
