"""Error fields: the phases of a known motion, errors that are known, baselines, floor, files, surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from plop.comparison.error_fields import band_text, error_field, tables
from plop.comparison.field_file import read_field, stored_field, write_field
from plop.errors import PlopError
from plop.physics.engine.tool_motion import ToolMotion
from plop.tracking.episode import Episode, convex_surface
from plop.tracking.motion_interpolation import MotionInterpolation, fine_surface
from plop.tracking.phases import PHASES, spans, view_tool
from tests.support.compare_scene import FRAMES, PHASE_NAMES, cut_and_push, moved, surface_points

NOISE_M = 2e-4


@pytest.fixture(scope="module")
def episode() -> Episode:
    sequence, points = cut_and_push("box_000"), surface_points(300)
    exact = np.stack([moved(points, frame) for frame in range(FRAMES)])
    noise = np.random.default_rng(0).normal(0, NOISE_M, exact.shape)
    tool = ToolMotion(sequence.tool_vertices, sequence.tool_faces, sequence.times, sequence.world_from_tool)
    hull = trimesh.convex.convex_hull(points)
    return Episode(
        "box_000",
        sequence.times,
        exact + noise,
        NOISE_M,
        (points[:, 0] > 0).astype(int),
        tool,
        0.0,
        np.asarray(hull.vertices),
        np.asarray(hull.faces),
    )


def test_phases_follow_the_tool(episode):
    phase = view_tool(episode).phase
    assert [PHASES[k] for k in phase] == PHASE_NAMES
    assert [name for _, _, name in spans(phase)] == ["approach", "cut", "hold", "contact", "hold", "retract"]


def test_distance_to_the_tool_is_that_of_its_surface(episode):
    view = view_tool(episode)
    above = episode.points[0, :, 2].max()
    # the edge of the blade is 45 mm above the table, and the nearest point lies below it
    assert view.distance_m[0].min() == pytest.approx(0.045 - above, abs=1.5e-3)


def test_a_known_error_comes_back(episode):
    shift = np.zeros_like(episode.points)
    shift[1:, :, 1] = 0.002
    field = error_field(episode, episode.points + shift)
    assert field.error_m[1:] == pytest.approx(0.002) and field.error_m[0] == pytest.approx(0)
    row = tables([field]).whole
    assert row.rms_mm == pytest.approx(2) and row.n == 300 * (FRAMES - 1)


def test_a_perfect_prediction_is_at_the_floor(episode):
    start = episode.points[0]
    steps = np.stack([moved(start, frame) for frame in range(FRAMES)])
    row = tables([error_field(episode, steps)]).whole
    assert row.in_noise == pytest.approx(1, abs=0.1)
    assert row.persistence_mm > 5 * row.floor_mm and row.rigid_mm < row.persistence_mm


def test_tables_tell_when_and_where(episode):
    shift = np.zeros_like(episode.points)
    held = [k for k, name in enumerate(PHASE_NAMES) if name == "hold"]
    high = episode.points[0, :, 2] > 0.02
    shift[np.ix_(held, np.flatnonzero(high), [2])] = 0.003
    found = tables([error_field(episode, episode.points + shift)])
    by_phase = {row.label: row.rms_mm for row in found.phase}
    assert max(by_phase, key=by_phase.get) == "hold" and by_phase["cut"] == pytest.approx(0)
    by_height = {row.label: row.rms_mm for row in found.height}
    assert by_height["20-30"] > 1 and by_height["10-20"] == pytest.approx(0, abs=0.2)
    assert sum(row.n for row in found.distance) == found.whole.n


def test_what_the_tool_hides_does_not_count(episode):
    from dataclasses import replace

    seen = np.ones(episode.points.shape[:2], bool)
    seen[:, :10] = False
    shift = np.zeros_like(episode.points)
    shift[1:, :10] = 0.01
    row = tables([error_field(replace(episode, seen=seen), episode.points + shift)]).whole
    assert row.rms_mm == pytest.approx(0) and row.n == 290 * (FRAMES - 1)


@pytest.mark.parametrize("spoil", [lambda p: p * 1000, lambda p: p[:-1], lambda p: np.where(p > 0.029, np.nan, p)])
def test_predictions_that_cannot_be_compared_are_refused(episode, spoil):
    with pytest.raises(PlopError, match="prediction"):
        error_field(episode, spoil(episode.points))


def test_fields_come_back_from_their_file(episode, tmp_path):
    stored = stored_field(error_field(episode, episode.points + 0.0))
    write_field(tmp_path / "a.npz", stored)
    again = read_field(tmp_path / "a.npz")
    for name, value in vars(stored).items():
        np.testing.assert_allclose(getattr(again, name), value, atol=1e-6) if name != "name" else None
    assert again.name == "box_000"
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:200])
    with pytest.raises(PlopError, match="cannot be read"):
        read_field(tmp_path / "a.npz")


def test_a_divided_surface_stays_closed_and_keeps_its_volume():
    vertices, faces = convex_surface(np.random.default_rng(0).normal(size=(60, 3)) * [0.03, 0.02, 0.01])
    fine = trimesh.Trimesh(*fine_surface(vertices, faces, 0.008), process=False)
    assert fine.is_watertight and fine.edges_unique_length.max() <= 0.008
    assert fine.volume == pytest.approx(trimesh.Trimesh(vertices, faces).volume)


def test_what_is_carried_moves_with_its_own_side(episode):
    places = np.array([[-0.002, 0.0, 0.03], [0.002, 0.0, 0.03]])
    start = surface_points(300)
    motion = MotionInterpolation(start, episode.patch, places)
    assert motion.places_at(moved(start, 6)) == pytest.approx(moved(places, 6), abs=1e-9)


def test_bands_are_written_in_millimetres():
    assert [band_text(0, 0.005), band_text(0.005, 0.01), band_text(0.04, np.inf)] == ["< 5", "5-10", "> 40"]
