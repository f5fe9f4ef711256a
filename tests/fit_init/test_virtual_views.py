from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from plop.geometry.cameras import Camera
from plop.recordings.recording import MaskLabel, View
from plop.render.mesh_raycast import Look, MeshRenderer
from plop.render.texture import SolidTexture
from stages.fit_init.episode import fit_object
from stages.fit_init.held_out import score_view
from stages.fit_init.shell import surface_from_views
from stages.fit_init.stage import FitInitConfig
from stages.fit_init.virtual_views import virtual_views
from tests.support.box_sequence import box_sequence
from tests.support.ellipsoid_scene import ellipsoid_distance, render, ring


def views(count: int = 6, size: int = 96, noise_m: float = 0.0) -> list[View]:
    """See the scene as cameras do: a pixel's colour is the mean over nine rays, object and background alike."""
    generator = np.random.default_rng(0)
    found = []
    for camera, fine in zip(ring(count, size), ring(count, 3 * size)):
        rgb = render(fine)[0].reshape(size, 3, size, 3, 3).mean((1, 3)).round().astype(np.uint8)
        _, depth, mask = render(camera)
        noise = generator.normal(0, noise_m, depth.shape) * (depth > 0)
        found.append(View(camera, rgb, (depth + noise).astype(np.float32), mask))
    return found


@pytest.mark.parametrize(("noise_m", "off_px"), [(0.0, 0.2), (5e-4, 0.3)])
def test_a_virtual_view_is_what_a_camera_there_would_see(noise_m: float, off_px: float):
    drawn = virtual_views(views(noise_m=noise_m), 5)
    assert len(drawn) == 5
    for view in drawn:
        rgb, depth, mask = render(view.camera)
        shown, known = mask == MaskLabel.OBJECT, view.mask != MaskLabel.UNKNOWN
        assert known[shown].mean() > 0.9
        assert (view.object_mask & ~shown).sum() < 0.03 * shown.sum()
        assert ((view.mask == MaskLabel.BACKGROUND) & shown).sum() < 0.02 * shown.sum()
        both = view.object_mask & shown
        pixel_m = depth[both].mean() / view.camera.intrinsics[0, 0]
        assert np.abs(view.depth_m - depth)[both].mean() < off_px * pixel_m
        assert np.abs(view.rgb.astype(float) - rgb)[both].mean() < 4


def box_views(cameras: list[Camera]) -> list[View]:
    """See a box on a black table: what is mixed into its colour darkens it."""
    black = Look(SolidTexture.from_seed(3), table=(0.0, 0.0, 0.0), nothing=(0.0, 0.0, 0.0))
    renderer = MeshRenderer(box_sequence(gap_m=0.0, height_m=0.06), black)
    seen = [renderer.render(0, camera) for camera in cameras]
    return [View(camera, shown.rgb, shown.depth_m, shown.mask) for camera, shown in zip(cameras, seen)]


def test_outlines_of_a_box_are_no_wider_than_it_is_and_have_its_own_colour():
    around = [camera for height in (0.15, 0.3) for camera in ring(4, 96, height=height)]
    drawn = virtual_views(box_views(around), 12)
    inner, outer = [], []
    for view, true in zip(drawn, box_views([view.camera for view in drawn])):
        known = (view.mask != MaskLabel.UNKNOWN) & ~binary_dilation(true.tool_mask, iterations=2)
        own = true.rgb[binary_erosion(true.object_mask, iterations=2)].mean()
        brighter = (view.rgb.astype(float) - true.rgb).mean(2) / own
        inner.append(brighter[true.object_mask & binary_dilation(~true.object_mask) & known].mean())
        outer.append(brighter[~true.object_mask & binary_dilation(true.object_mask) & known].mean())
    assert np.mean(inner) > -0.05, "the table's colour is mixed in"
    assert abs(np.mean(outer)) < 0.015, "pieces of several cameras end beyond the edges"


def test_a_side_that_nobody_saw_is_unknown():
    near = [view for view in views() if view.camera.world_from_cam[0, 3] > 0.1]
    assert 2 <= len(near) < 6
    for view in virtual_views(near, 8):
        _, _, mask = render(view.camera)
        shown = mask == MaskLabel.OBJECT
        assert ((view.mask == MaskLabel.BACKGROUND) & shown).sum() < 0.04 * shown.sum(), "never taken for empty"
        if view.camera.world_from_cam[0, 3] < -0.2:
            assert (view.mask[shown] == MaskLabel.UNKNOWN).mean() > 0.3


def test_a_piece_that_others_see_through_is_not_drawn():
    wrong = views()
    depth = wrong[0].depth_m.copy()
    rows, columns = np.nonzero(wrong[0].object_mask)
    patch = (slice(int(rows.mean()) - 4, int(rows.mean()) + 5), slice(int(columns.mean()) - 4, int(columns.mean()) + 5))
    depth[patch] -= 0.03
    drawn = virtual_views([replace(wrong[0], depth_m=depth), *wrong[1:]], 8)
    for view in drawn:
        points = view.camera.back_project(view.depth_m, view.object_mask)
        assert np.abs(ellipsoid_distance(points)).max() < 6e-3, "the piece stands 30 mm before the surface"


def test_the_tool_is_not_drawn_and_hides_nothing_that_others_see():
    bladed = views()
    mask = bladed[0].mask.copy()
    mask[:, 44:52] = MaskLabel.TOOL
    drawn = virtual_views([replace(bladed[0], mask=mask), *bladed[1:]], 6)
    assert not any(view.tool_mask.any() for view in drawn)
    for view in drawn:
        shown = render(view.camera)[2] == MaskLabel.OBJECT
        assert view.object_mask[shown].mean() > 0.85


def test_without_two_depth_images_there_are_none():
    flat = [replace(view, depth_m=np.zeros_like(view.depth_m)) for view in views(3)]
    assert virtual_views(flat, 4) == []
    assert virtual_views([views(3)[0], *flat[1:]], 4) == []
    assert virtual_views(views(3), 0) == []
    scattered = (np.indices((96, 96)) % 3 == 0).all(0)  # no three neighbours make a plane
    assert virtual_views([replace(view, depth_m=view.depth_m * scattered) for view in views(3)], 4) == []


def test_a_view_that_no_camera_took_is_fitted_better_with_them():
    around = views()
    config = FitInitConfig(count=900, steps=300, filling="none", virtual_views=0)
    surface, scores = surface_from_views(around[1:]), []
    for count in (0, 8):
        shell, _ = fit_object(surface, around[1:], None, replace(config, virtual_views=count))
        scores.append(score_view(shell, around[0])[0].psnr_db)
    assert scores[1] > scores[0] + 0.2
