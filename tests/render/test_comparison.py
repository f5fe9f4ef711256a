"""Pictures for people: how far the surfaces are apart in millimetres, at a size and in colours that can be read."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from plop.geometry.cameras import Camera, look_at
from plop.geometry.view import MaskLabel, View
from plop.metrics.surface_distance import distance_map_mm, scale_end_mm
from plop.render.pictures.comparison import compared_views
from plop.render.pictures.enlarge import Crop, enlarged, enlarged_mask
from plop.render.pictures.panels import PANEL_PX, Layout, Titles, distance_colours, millimetres


def camera(height: int = 60, width: int = 80) -> Camera:
    matrix = np.array([[100.0, 0, width / 2], [0, 100.0, height / 2], [0, 0, 1]])
    pose = look_at(np.array([0.0, 0, 0.4]), np.zeros(3), np.array([0.0, 1, 0]))
    return Camera("top", width, height, matrix, pose)


def plate(depth_m: float, *, rows=slice(20, 40), columns=slice(30, 50), height: int = 60, width: int = 80) -> View:
    """A flat square that lies straight across the camera's view."""
    mask = np.zeros((height, width), np.uint8)
    mask[rows, columns] = MaskLabel.OBJECT
    depth = np.where(mask == MaskLabel.OBJECT, depth_m, 0).astype(np.float32)
    rgb = np.where(mask[..., None] == MaskLabel.OBJECT, np.uint8(180), np.uint8(20)).repeat(3, -1)
    return View(camera(height, width), rgb, depth, mask)


def whole_map(measured: View, predicted: View) -> np.ndarray:
    height, width = measured.mask.shape
    return distance_map_mm([measured], [predicted], 0, np.arange(height), np.arange(width))


@pytest.mark.parametrize("off_mm", [-7.0, 0.5, 3.0])
def test_a_plate_that_is_too_near_or_too_far_is_off_by_that_much(off_mm):
    found = whole_map(plate(0.4), plate(0.4 + off_mm / 1000))
    assert (np.isfinite(found) == plate(0.4).object_mask).all()
    assert np.median(found[np.isfinite(found)]) == pytest.approx(abs(off_mm), rel=0.02)


def test_equal_views_are_0_apart_even_where_clouds_are_thinned(monkeypatch):
    monkeypatch.setattr("plop.metrics.surface_distance.MOST_POINTS", 20)
    found = whole_map(plate(0.4), plate(0.4))
    assert np.nanmax(found) == 0


def test_a_plate_beside_the_measured_one_is_as_far_as_its_nearest_point():
    # 10 pixels further: 40 mm at 0.4 m. Its far column is 40 mm from the measured one, so is the uncovered one.
    found = whole_map(plate(0.4), plate(0.4, columns=slice(40, 60)))
    assert np.nanmax(found) == pytest.approx(40, abs=0.1)
    assert found[30, 59] == pytest.approx(40, abs=0.1), "only predicted there"
    assert found[30, 30] == pytest.approx(40, abs=0.1), "only measured there"
    assert found[30, 45] == 0


def test_other_cameras_surfaces_count():
    seen, hidden = plate(0.4), plate(0.4)
    hidden = dataclasses.replace(hidden, mask=np.zeros_like(hidden.mask))
    assert np.isnan(whole_map(seen, hidden)).all(), "no predicted surface anywhere"
    both = distance_map_mm([seen, seen], [hidden, seen], 0, np.arange(60), np.arange(80))
    assert np.nanmax(both) < 1e-3


@pytest.mark.parametrize("spoil", ["no depth", "nan depth", "tool", "unknown", "no mask"])
def test_what_was_not_measured_has_no_distance(spoil):
    view = plate(0.4)
    depth, mask = view.depth_m.copy(), view.mask.copy()
    if "depth" in spoil:
        depth[:, :40] = np.nan if spoil == "nan depth" else 0
    else:
        mask[:, :40] = {"tool": MaskLabel.TOOL, "unknown": MaskLabel.UNKNOWN, "no mask": 0}[spoil]
    found = whole_map(View(view.camera, view.rgb, depth, mask), plate(0.4))
    assert np.isfinite(found[25:35, 41:49]).all()
    # A predicted pixel that should show background has the distance to the nearest measured point.
    assert np.isfinite(found[30, 35]) == (spoil == "no mask")


def test_the_scale_is_round_and_a_few_pixels_do_not_stretch_it():
    values = np.concatenate([np.full(990, 1.3), np.full(10, 60.0), [np.nan]])
    assert scale_end_mm([values], 0.2) == 2
    assert scale_end_mm([values], 3.0) == 5, "no finer than a pixel"
    assert scale_end_mm([np.full(9, 0.02)], 0.0) == pytest.approx(0.02)
    assert scale_end_mm([np.full(9, 137.0)], 0.0) == 200
    assert scale_end_mm([np.full(3, np.nan)], 0.0) > 0


@pytest.mark.parametrize(("height", "width"), [(64, 64), (96, 96), (480, 640), (640, 360), (1080, 1920), (40, 400)])
@pytest.mark.parametrize("where", ["middle", "corner", "pixel", "nowhere"])
def test_people_see_the_object_at_512_px_wherever_it_is(height, width, where):
    mask = np.zeros((height, width), bool)
    boxes = {
        "middle": (slice(height // 3, 2 * height // 3), slice(width // 3, width // 2)),
        "corner": (slice(0, height // 5), slice(width - width // 6, width)),
        "pixel": (slice(height - 1, height), slice(2, 3)),
        "nowhere": (slice(0, 0), slice(0, 0)),
    }
    mask[boxes[where]] = True
    crop = Crop.around([mask, mask], PANEL_PX)
    assert max(crop.size) == PANEL_PX and min(crop.size) >= 2
    assert crop.of(mask).sum() == mask.sum() and crop.of(mask).shape == (crop.rows, crop.columns)
    rows, columns = crop.grid(192)
    assert 1 <= max(len(rows), len(columns)) <= 192 and rows[-1] < height and columns[-1] < width


def test_the_larger_camera_sees_a_point_at_the_same_place():
    mask = np.zeros((60, 80), bool)
    mask[10:30, 40:70] = True
    crop, point = Crop.around([mask], PANEL_PX), np.array([[0.03, 0.02, 0.01]])
    (before,), _ = camera().project(point)
    (after,), _ = crop.camera(camera()).project(point)
    scale = np.array(crop.size[::-1]) / [crop.columns, crop.rows]
    assert after == pytest.approx((before - [crop.left, crop.top]) * scale)


def test_an_enlarged_outline_lies_where_it_was_and_a_thin_line_is_kept():
    mask = np.zeros((30, 30), bool)
    mask[8:20, 6:24] = True
    large = enlarged_mask(mask, (300, 300)) > 0.5
    expected = mask.repeat(10, 0).repeat(10, 1)
    assert (large & expected).sum() / (large | expected).sum() > 0.97
    line = np.zeros((30, 30), bool)
    line[:, 12] = True
    assert (enlarged_mask(line, (300, 300))[150] > 0.5).sum() == pytest.approx(10, abs=4)


def test_unknown_values_leave_no_trace_when_enlarged():
    values, known = np.full((10, 10), 1e9), np.zeros((10, 10), bool)
    values[4:6, 4:6], known[4:6, 4:6] = 2.0, True
    assert enlarged(values, known, (50, 50), smooth_px=0.8) == pytest.approx(2)
    assert (enlarged(values, np.zeros_like(known), (50, 50), smooth_px=0.8) == 0).all()


def test_farther_is_always_darker_and_nothing_is_black():
    ramp = distance_colours(np.linspace(0, 5, 50), 5.0).astype(float) @ [0.299, 0.587, 0.114]
    assert (np.diff(ramp) <= 1e-9).all() and ramp[0] > 230 and ramp[-1] > 30
    assert (distance_colours(np.array([9.0]), 5.0) == distance_colours(np.array([5.0]), 5.0)).all()


def test_a_page_has_titles_a_bar_and_numbers_beside_three_panels():
    titles = (Titles("measured"), Titles("predicted"), Titles("distance", "in mm"))
    panel = np.full((300, 401, 3), 90, np.uint8)
    page, bare = (Layout(titles, (300, 401), end).page([panel] * 3, ("a", "b", "c")) for end in (5.0, None))
    assert page.shape[0] % 2 == page.shape[1] % 2 == 0 and page.shape[1] > bare.shape[1] >= 3 * 401
    assert (page == 90).all(-1).sum() >= 3 * panel[..., 0].size
    bar = page[:, bare.shape[1] :].astype(int)
    assert (bar[..., 0] - bar[..., 2] > 100).sum() > 1000, "colours from yellow to red"


@pytest.mark.parametrize(("height", "width"), [(64, 64), (120, 48), (48, 120)])
def test_small_portrait_and_wide_cameras_make_a_page(height, width):
    places = {"rows": slice(height // 3, height // 2), "columns": slice(width // 3, width // 2)}
    views = [plate(depth, height=height, width=width, **places) for depth in (0.4, 0.41)]
    page = compared_views(*views)
    assert page.shape[0] % 2 == page.shape[1] % 2 == 0 and page.shape[0] >= 384 and page.std() > 10


def test_a_view_without_depth_or_object_still_makes_a_page():
    view = plate(0.4)
    blind = dataclasses.replace(view, depth_m=np.zeros_like(view.depth_m))
    for measured in (blind, dataclasses.replace(blind, mask=np.zeros_like(view.mask))):
        assert compared_views(measured, view).shape[2] == 3


def test_millimetres_are_written_with_the_digits_that_one_reads():
    assert [millimetres(value) for value in (0.1234, 0.999, 1.26, 9.96, 123.4)] == [
        "0.12 mm",
        "1.0 mm",
        "1.3 mm",
        "10 mm",
        "123 mm",
    ]
