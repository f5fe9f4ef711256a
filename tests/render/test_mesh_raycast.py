"""Rendered meshes: exact depth, exact labels, colour that belongs to the material."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from plop.geometry.cameras import Camera, look_at
from plop.recordings.recording import MaskLabel
from plop.render.mesh_raycast import Light, Look, MeshRenderer
from plop.render.texture import SolidTexture, seed_from
from tests.support.box_sequence import box_sequence

TEXTURE = SolidTexture.from_seed(3)
FLAT = Look(TEXTURE, Light(ambient=1.0, directional=0.0))


def camera_above(size: int = 48, height_m: float = 0.3) -> Camera:
    intrinsics = np.array([[2.0 * size, 0, size / 2], [0, 2.0 * size, size / 2], [0, 0, 1]])
    return Camera(
        "top", size, size, intrinsics, look_at(np.array([0.0, 0, height_m]), np.zeros(3), np.array([0.0, 1, 0]))
    )


def camera_aslant(size: int = 48) -> Camera:
    above = camera_above(size)
    pose = look_at(np.array([0.2, -0.15, 0.18]), np.array([0.0, 0, 0.015]), np.array([0.0, 0, 1]))
    return dataclasses.replace(above, world_from_cam=pose)


def test_depth_from_above_is_the_distance_of_the_planes() -> None:
    view = MeshRenderer(box_sequence(gap_m=0.0), FLAT).render(0, camera_above())
    body, ground = view.mask == MaskLabel.OBJECT, view.mask == MaskLabel.BACKGROUND
    np.testing.assert_allclose(view.depth_m[body], 0.27, atol=1e-6)
    np.testing.assert_allclose(view.depth_m[ground], 0.30, atol=1e-6)
    assert view.depth_m.dtype == np.float32 and body.any() and (view.mask == MaskLabel.TOOL).any()


def test_every_object_pixel_lies_on_the_box_and_every_silhouette_agrees_with_the_projection() -> None:
    sequence, camera = box_sequence(), camera_aslant()
    view = MeshRenderer(sequence, FLAT).render(0, camera)
    points = camera.back_project(view.depth_m, view.mask == MaskLabel.OBJECT)
    outside = np.abs(points - [0, 0, 0.015]) - [0.03, 0.03, 0.015]
    assert np.abs(outside.max(1)).max() < 1e-6, "on the surface: one coordinate at its limit, none beyond"
    pixels, _ = camera.project(sequence.vertices[0])
    rows, columns = np.nonzero(view.mask == MaskLabel.OBJECT)
    assert columns.min() >= np.floor(pixels[:, 0].min()) and columns.max() <= np.ceil(pixels[:, 0].max())
    assert rows.min() >= np.floor(pixels[:, 1].min()) and rows.max() <= np.ceil(pixels[:, 1].max())


def test_looking_only_where_something_moves_changes_no_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    from plop.render import mesh_raycast

    sequence, camera = box_sequence(), camera_aslant()
    quick = MeshRenderer(sequence, FLAT).render(2, camera)
    monkeypatch.setattr(mesh_raycast, "window", lambda c, points: (slice(0, c.height), slice(0, c.width)))
    full = MeshRenderer(sequence, FLAT).render(2, camera)
    for field in ("rgb", "depth_m", "mask"):
        np.testing.assert_array_equal(getattr(quick, field), getattr(full, field))


def test_colour_moves_with_the_material() -> None:
    sequence = box_sequence(gap_m=0.0)
    lift = np.eye(4)
    lift[2, 3] = 0.02
    moved = dataclasses.replace(
        sequence, vertices=sequence.vertices + lift[:3, 3], world_from_tool=lift @ sequence.world_from_tool
    )
    near, far = camera_above(height_m=0.3), camera_above(height_m=0.32)
    still = MeshRenderer(sequence, FLAT).render(0, near)
    lifted = MeshRenderer(moved, FLAT).render(0, far)
    both = (still.mask == MaskLabel.OBJECT) & (lifted.mask == MaskLabel.OBJECT)
    assert both.sum() > 100
    assert np.abs(still.rgb[both].astype(int) - lifted.rgb[both]).max() <= 1


def test_the_middle_of_a_pixel_shows_the_texture_of_its_material_point() -> None:
    camera = camera_above(64)
    view = MeshRenderer(box_sequence(gap_m=0.0), FLAT, supersample=1).render(0, camera)
    body = view.mask == MaskLabel.OBJECT
    points = camera.back_project(view.depth_m, body)
    expected = TEXTURE.colour(points, np.zeros(len(points), bool))
    np.testing.assert_allclose(view.rgb[body] / 255, expected, atol=0.003)


def test_cut_faces_have_their_own_hue_once_the_cut_is_open() -> None:
    sequence = dataclasses.replace(box_sequence(gap_m=0.05), tool_vertices=box_sequence().tool_vertices * 1e-3)
    camera = camera_aslant(96)
    view = MeshRenderer(sequence, FLAT, supersample=1).render(2, camera)
    points = camera.back_project(view.depth_m, view.mask == MaskLabel.OBJECT)
    colours = view.rgb[view.mask == MaskLabel.OBJECT] / 255
    on_cut = np.abs(points[:, 0]) < 1e-5
    assert on_cut.sum() > 20
    np.testing.assert_allclose(colours[on_cut], TEXTURE.colour(points[on_cut], np.ones(on_cut.sum(), bool)), atol=0.003)


def test_without_a_table_there_is_nothing_behind_the_object() -> None:
    view = MeshRenderer(dataclasses.replace(box_sequence(), table_z_m=None), FLAT).render(0, camera_aslant())
    assert (view.depth_m[view.mask == MaskLabel.BACKGROUND] == 0).all()
    assert (view.depth_m[view.mask == MaskLabel.OBJECT] > 0).all()


def test_the_tool_hides_what_lies_behind_it() -> None:
    sequence, camera = box_sequence(), camera_above()
    with_tool = MeshRenderer(sequence, FLAT).render(0, camera)
    tool = with_tool.mask == MaskLabel.TOOL
    assert tool.any() and (with_tool.depth_m[tool] < 0.27).all()


def test_an_even_supersample_is_refused() -> None:
    with pytest.raises(ValueError, match="odd"):
        MeshRenderer(box_sequence(), FLAT, supersample=2)


@pytest.mark.parametrize("drawn", [SolidTexture.from_seed, SolidTexture.dough])
def test_texture_depends_on_its_seed_only(drawn) -> None:
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3))
    outside = np.zeros(200, bool)
    one, same, other = (drawn(seed_from("box", s)).colour(points, outside) for s in (0, 0, 1))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).mean() > 0.05
    assert one.std(0).min() > 0.05, "colour carries information"
    assert one.min() >= 0 and one.max() <= 1


@pytest.mark.parametrize("seed", range(12))
def test_dough_is_warm_of_one_hue_and_its_cut_is_seen(seed: int) -> None:
    points = np.random.default_rng(0).uniform(-0.04, 0.04, (2000, 3))
    texture = SolidTexture.dough(seed)
    outside, inside = (texture.colour(points, np.full(2000, cut)) for cut in (False, True))
    for colours in (outside, inside):
        assert (colours[:, 0] >= colours[:, 2]).mean() > 0.95, "never blue"
        assert colours.mean(1).std() > 0.08, "light and dark can be tracked"
        own = (colours - colours.mean(1, keepdims=True)).std(0).max()
        assert own < 0.6 * colours.mean(1).std(), "brightness, not hue"
    assert np.abs(inside.mean(0) - outside.mean(0)).mean() > 0.05
