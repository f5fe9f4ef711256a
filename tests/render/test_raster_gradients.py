"""Oracles: the plain-torch rasterizer against finite differences, the fast backends against plain torch."""

import pytest
import torch

from plop.gaussians.state import Gaussians
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.rasterize import render, render_many
from tests.render.gsplat_on_cpu import without_cuda
from tests.render.raster_scene import FIELDS, camera_at, random_gaussians, relative_error, weighted_sum, with_gradients

EYE = (0.12, -0.3, 0.2)


def assert_alike(
    found: list[Rendering], expected: list[Rendering], ours: Gaussians, theirs: Gaussians, images: float, slopes: float
) -> None:
    """Compare views, and gradients of a weighted sum of them, relative to the largest expected value."""
    for a, b in zip(found, expected, strict=True):
        for name in ("rgb", "depth_m", "alpha"):
            assert relative_error(getattr(a, name).cpu(), getattr(b, name)) < images, name
    weighted_sum(expected).backward()
    weighted_sum(found).backward()
    for name in FIELDS:
        assert relative_error(getattr(ours, name).grad.cpu(), getattr(theirs, name).grad) < slopes, name


def test_reference_passes_gradcheck():
    scene = random_gaussians(3, degree=1, seed=4, dtype=torch.float64)
    # Wide and faint, so that no pixel is near a threshold, where the image jumps.
    scene = scene.with_(scales=scene.scales + 0.06, opacities=0.1 + 0.5 * scene.opacities)
    camera = camera_at((0.1, -0.35, 0.2), width=5, height=4)

    def images(*values: torch.Tensor) -> tuple[torch.Tensor, ...]:
        image = render(Gaussians(*values, scene.ids), camera, backend="torch")
        return image.rgb, image.depth_m, image.alpha

    inputs = [getattr(with_gradients(scene, torch.float64), name) for name in FIELDS]
    assert torch.autograd.gradcheck(images, inputs, eps=1e-7, atol=1e-5)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 40, 600])
def test_numba_equals_reference(count, degree):
    scene = random_gaussians(count, degree=degree, seed=10 * count + degree)
    cameras = [camera_at(EYE), camera_at((-0.2, -0.25, 0.15))]
    background = torch.tensor([0.1, 0.2, 0.3])
    exact, fast = with_gradients(scene, torch.float64), with_gradients(scene, torch.float32)
    expected = render_many(exact, cameras, background=background, backend="torch")
    found = render_many(fast, cameras, background=background, backend="numba")
    assert_alike(found, expected, fast, exact, 1e-5, 1e-4)


@pytest.mark.parametrize("output", ["rgb", "depth_m", "alpha"])
def test_numba_gradient_of_each_output_alone(output):
    scene, camera = random_gaussians(80, seed=3), camera_at(EYE)
    exact, fast = with_gradients(scene, torch.float64), with_gradients(scene, torch.float32)
    for gaussians, backend in ((exact, "torch"), (fast, "numba")):
        image = getattr(render(gaussians, camera, backend=backend), output)
        weights = torch.randn(image.shape, generator=torch.Generator().manual_seed(2)).to(image)
        (image * weights).sum().backward()
    for name in FIELDS:
        if output != "rgb" and name == "sh":
            assert float(fast.sh.grad.abs().max()) == 0
        else:
            assert relative_error(getattr(fast, name).grad, getattr(exact, name).grad) < 1e-4, name


def test_numba_where_the_jacobian_is_limited_and_gaussians_cross_the_border():
    scene = random_gaussians(60, seed=7)
    scene = scene.with_(means=scene.means * 6, scales=scene.scales * 15)
    camera = camera_at((0.1, -0.2, 0.15), width=30, height=19)
    exact, fast = with_gradients(scene, torch.float64), with_gradients(scene, torch.float32)
    expected, found = render(exact, camera, backend="torch"), render(fast, camera, backend="numba")
    assert relative_error(found.rgb, expected.rgb) < 1e-5
    weighted_sum([expected]).backward()
    weighted_sum([found]).backward()
    for name in FIELDS:
        assert relative_error(getattr(fast, name).grad, getattr(exact, name).grad) < 1e-4, name


def test_numba_sorts_depths_that_float32_cannot_tell_apart():
    # Nanometres apart at 0.42 m: float32 resolves 30.
    scene = random_gaussians(40, seed=8)
    scene = scene.with_(means=torch.tensor([[0.0, 0.0, 1e-9 * (i * 7 % 40)] for i in range(40)]))
    camera = camera_at((0.0, -0.3, 0.3))
    found = render(scene, camera, backend="numba")
    exact = scene.with_(**{name: getattr(scene, name).double() for name in FIELDS})
    assert relative_error(found.rgb, render(exact, camera, backend="torch").rgb) < 1e-5


def test_numba_is_deterministic_and_independent_of_threads():
    scene, camera = random_gaussians(400, seed=5), camera_at(EYE)
    threads, results = torch.get_num_threads(), []
    try:
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            gaussians = with_gradients(scene, torch.float32)
            weighted_sum([render(gaussians, camera, backend="numba")]).backward()
            results.append([getattr(gaussians, name).grad for name in FIELDS])
    finally:
        torch.set_num_threads(threads)
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            assert torch.equal(a, b)


def test_numba_takes_the_dtype_of_the_means_and_passes_the_background_gradient():
    gaussians = with_gradients(random_gaussians(30), torch.float64)
    background = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    image = render(gaussians, camera_at(EYE), background=background, backend="numba")
    assert image.rgb.dtype == image.depth_m.dtype == torch.float64
    image.rgb.sum().backward()
    torch.testing.assert_close(background.grad, (1 - image.alpha).sum().detach().expand(3))
    assert gaussians.means.grad.dtype == torch.float64


def test_gsplat_equals_numba():
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device; gsplat cannot run on a CPU")
    pytest.importorskip("gsplat")
    scene, cameras = random_gaussians(600, degree=3), [camera_at(EYE), camera_at((-0.2, -0.25, 0.15))]
    on_cpu, on_gpu = with_gradients(scene, torch.float32), with_gradients(scene.to("cuda"), torch.float32)
    expected, found = render_many(on_cpu, cameras, backend="numba"), render_many(on_gpu, cameras)
    assert_alike(found, expected, on_gpu, on_cpu, 1e-3, 1e-2)


@pytest.mark.parametrize("degree", [0, 3])
def test_gsplat_without_its_kernels_equals_numba(monkeypatch: pytest.MonkeyPatch, degree: int):
    pytest.importorskip("gsplat")
    scene, cameras = random_gaussians(60, degree=degree), [camera_at(EYE), camera_at((-0.2, -0.25, 0.15))]
    background = torch.tensor([0.1, 0.5, 0.9])
    ours, theirs = with_gradients(scene, torch.float32), with_gradients(scene, torch.float32)
    expected = render_many(ours, cameras, background=background, backend="numba")
    without_cuda(monkeypatch)
    found = render_many(theirs, cameras, background=background, backend="gsplat")
    assert_alike(found, expected, theirs, ours, 1e-3, 1e-2)
