"""Laws that every backend of the rasterizer obeys, and its refusal of bad input."""

import math

import numpy as np
import pytest
import torch

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.geometry.rigid import pose_from_euler_xyz, quat_multiply, transform_points
from plop.render.rasterizer.projection import LOW_PASS_PX2
from plop.render.rasterizer.rasterize import render, render_many
from tests.render.raster_scene import FIELDS, camera_at, random_gaussians, with_gradients

BACKENDS = ("torch", "numba")
EYE = (0.12, -0.3, 0.2)


def one_gaussian(mean, scale_m=0.002, opacity=1.0, colour=(0.2, 0.5, 0.8)) -> Gaussians:
    sh = (torch.tensor([[colour]]) - 0.5) / 0.28209479177387814
    return Gaussians(
        means=torch.tensor([mean], dtype=torch.float32),
        quats=torch.tensor([[2.0, 0.0, 0.0, 0.0]]),
        scales=torch.full((1, 3), scale_m),
        opacities=torch.tensor([opacity]),
        sh=sh,
        ids=torch.zeros(1, dtype=torch.int64),
    )


def frontal_camera() -> Camera:
    """Sit at the origin and look along +z, 1 px = 1 mm at 0.1 m, the middle of pixel (16, 16) on the axis."""
    return Camera("front", 33, 33, np.array([[100.0, 0, 16.5], [0, 100.0, 16.5], [0, 0, 1]]), np.eye(4))


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_gaussian_has_the_closed_form(backend):
    image = render(one_gaussian([0, 0, 0.1], scale_m=0.002, opacity=0.6), frontal_camera(), backend=backend)
    variance = 2.0**2 + LOW_PASS_PX2
    for column in (16, 17, 19):
        alpha = 0.6 * math.exp(-0.5 * (column - 16) ** 2 / variance)
        assert float(image.alpha[16, column]) == pytest.approx(alpha, rel=1e-5)
        assert image.rgb[16, column].tolist() == pytest.approx([alpha * c for c in (0.2, 0.5, 0.8)], rel=1e-5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_depth_of_one_opaque_gaussian_is_its_z(backend):
    image = render(one_gaussian([0.003, -0.002, 0.1234]), frontal_camera(), backend=backend)
    seen = image.alpha > 0
    assert 20 < int(seen.sum()) < 33 * 33
    torch.testing.assert_close(image.depth_m[seen], torch.full_like(image.depth_m[seen], 0.1234))
    assert bool((image.depth_m[~seen] == 0).all())


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_nearer_gaussian_hides_the_farther(backend):
    near = one_gaussian([0, 0, 0.1], opacity=0.9, colour=(1, 0, 0))
    far = one_gaussian([0, 0, 0.2], opacity=0.9, colour=(0, 1, 0), scale_m=0.004)
    both = Gaussians(*(torch.cat([getattr(far, f), getattr(near, f)]) for f in (*FIELDS, "ids")))
    centre = render(both, frontal_camera(), backend=backend).rgb[16, 16]
    assert centre.tolist() == pytest.approx([0.9, 0.09, 0.0], abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_moving_scene_and_camera_together_leaves_the_image(backend):
    gaussians, camera = random_gaussians(200, degree=0), camera_at(EYE)
    motion = pose_from_euler_xyz(np.array([0.3, -0.2, 0.1, 0.4, -0.7, 1.1]))
    turn = torch.tensor(_quat_of(motion), dtype=torch.float32)
    moved = gaussians.with_(
        means=torch.tensor(transform_points(motion, gaussians.means.double().numpy()), dtype=torch.float32),
        quats=quat_multiply(turn.expand(200, 4), gaussians.quats),
    )
    follower = Camera("follower", camera.width, camera.height, camera.intrinsics, motion @ camera.world_from_cam)
    before, after = render(gaussians, camera, backend=backend), render(moved, follower, backend=backend)
    torch.testing.assert_close(after.rgb, before.rgb, atol=2e-4, rtol=0)
    torch.testing.assert_close(after.depth_m, before.depth_m, atol=1e-4, rtol=0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_alpha_is_between_0_and_1_and_the_background_fills_the_rest(backend):
    gaussians, camera = random_gaussians(300), camera_at(EYE)
    colour = torch.tensor([0.3, 0.6, 0.9])
    black = render(gaussians, camera, backend=backend)
    filled = render(gaussians, camera, background=colour, backend=backend)
    assert float(black.alpha.min()) >= 0 and float(black.alpha.max()) <= 1
    assert 0.1 < float((black.alpha > 0.5).float().mean()) < 0.8
    torch.testing.assert_close(filled.rgb, black.rgb + (1 - black.alpha)[..., None] * colour)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_to_see_is_background_with_zero_gradients(backend):
    gaussians = with_gradients(random_gaussians(20), torch.float32)
    behind = gaussians.with_(means=gaussians.means - torch.tensor([0.0, 0.0, 0.5]))
    beside = gaussians.with_(means=gaussians.means + torch.tensor([9.0, 0.0, 1.0]))
    none = gaussians.select(torch.zeros(20, dtype=torch.bool))
    for scene in (behind, beside, none):
        image = render(scene, frontal_camera(), background=torch.tensor([0.0, 0.5, 1.0]), backend=backend)
        assert not image.alpha.any() and not image.depth_m.any()
        assert bool((image.rgb == torch.tensor([0.0, 0.5, 1.0])).all())
        (image.rgb.sum() + image.depth_m.sum() + image.alpha.sum()).backward()
    for name in FIELDS:
        assert float(getattr(gaussians, name).grad.abs().max()) == 0, name


@pytest.mark.parametrize("backend", BACKENDS)
def test_many_views_equal_single_views_in_order(backend):
    gaussians = random_gaussians(150, degree=2)
    cameras = [camera_at(EYE), camera_at((-0.3, 0.1, 0.2), width=20, height=33), camera_at((0.0, -0.35, 0.1))]
    together = render_many(gaussians, cameras, backend=backend)
    for camera, image in zip(cameras, together, strict=True):
        alone = render(gaussians, camera, backend=backend)
        assert image.rgb.shape == (camera.height, camera.width, 3)
        for name in ("rgb", "depth_m", "alpha"):
            torch.testing.assert_close(getattr(image, name), getattr(alone, name))


@pytest.mark.parametrize("field", FIELDS)
def test_nan_is_refused_by_name(field):
    gaussians = random_gaussians(5)
    values = getattr(gaussians, field).clone()
    values[3] = math.nan
    with pytest.raises(PlopError, match=rf"gaussians\.{field}(.|\n)*index 3"):
        render(gaussians.with_(**{field: values}), camera_at(EYE))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"opacities": torch.tensor([0.5, 3.0])}, "opacities are out of range"),
        ({"quats": torch.zeros(2, 4)}, "no rotation"),
        ({"scales": torch.ones(2, 2)}, "scales have a wrong shape"),
        ({"sh": torch.ones(2, 5, 3)}, "spherical harmonics"),
    ],
)
def test_wrong_gaussians_are_refused(change, message):
    with pytest.raises(PlopError, match=message):
        render(random_gaussians(2).with_(**change), camera_at(EYE))


def test_wrong_cameras_backgrounds_and_backends_are_refused():
    gaussians, camera = random_gaussians(2), camera_at(EYE)
    lost = Camera("lost", 4, 4, camera.intrinsics, np.full((4, 4), np.nan))
    with pytest.raises(PlopError, match=r"world_from_cam(.|\n)*camera lost"):
        render(gaussians, lost)
    with pytest.raises(PlopError, match="no pixels"):
        render(gaussians, Camera("flat", 4, 0, camera.intrinsics, np.eye(4)))
    with pytest.raises(PlopError, match="background"):
        render(gaussians, camera, background=torch.ones(4))
    with pytest.raises(PlopError, match="near plane"):
        render(gaussians, camera, near_m=0.0)
    with pytest.raises(PlopError, match="backend"):
        render(gaussians, camera, backend="opengl")
    with pytest.raises(PlopError, match="CUDA"):
        render(gaussians, camera, backend="gsplat")


def _quat_of(pose: np.ndarray) -> list[float]:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return [w, x, y, z]
