"""Faults are judged by how far they displace the object, all together, and by how many episodes show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from plop.sensors.estimation.displacement import Displacement, displacement_form, misfit
from plop.sensors.estimation.finding import Episode, State, judge
from plop.sensors.estimation.fit import CameraFit, Evidence
from plop.sensors.estimation.parameters import COUNT, SLICES, TOTAL
from plop.sensors.estimation.residuals import PATTERNS
from plop.sensors.estimation.rig import judge_rig

SEEN = Displacement(displacement_form(np.array([0.0, 0.0, 0.4]), 0.05, 0.1, np.linspace(0, 1, 21)), 1.5e-3)
WELL = {"clock": 1e-3, "pose_error": 1e-4, "pose_drift": 1e-4, "depth_scale": 2e-4, "depth_bias": 1e-4}
"""Standard errors of a camera that sees all it needs."""


def deviations(**values: float | list[float]) -> np.ndarray:
    out = np.zeros(TOTAL)
    for name, part in values.items():
        out[SLICES[name]] = part
    return out


def episode(**values: float | list[float]) -> Episode:
    """Give an episode in which every parameter was measured by itself."""
    return measured(deviations(**values), deviations(**WELL, tool_offset=[1.0] * 3, tool_thickness=1.0))


def measured(values: np.ndarray, errors: np.ndarray) -> Episode:
    precision = np.r_[errors**-2.0, np.zeros(2 * PATTERNS)]
    evidence = Evidence(np.diag(precision), precision * np.r_[values, np.zeros(2 * PATTERNS)])
    return Episode(CameraFit(21, evidence, 1e-3, {"table": 1, "tool": 1, "outline": 1}), SEEN)


def names(finding) -> list[str]:
    return [each.fault for each in finding.found]


@pytest.mark.parametrize(
    ("name", "part", "expected"),
    [
        ("clock", 0.01, 1e-3),
        ("depth_scale", 0.01, 4e-3),
        ("depth_bias", 3e-3, 3e-3),
        ("pose_error", [0, 0, 2e-3, 0, 0, 0], 2e-3),
        ("pose_drift", [0, 3e-3, 0, 0, 0, 0], 3e-3 / np.sqrt(3)),
        ("tool_offset", [0, 3e-3, 0], 3e-3),
    ],
)
def test_each_fault_displaces_the_object_as_it_should(name, part, expected):
    assert SEEN.root(deviations(**{name: part})) == pytest.approx(expected, rel=0.05)


def test_the_misfit_is_the_distance_to_the_nearest_harmless_parameters():
    random = np.random.default_rng(3)
    mixed, shape = random.normal(size=(4, 4)), random.normal(size=(2, 4))
    covariance, squared = mixed @ mixed.T + 0.1 * np.eye(4), shape.T @ shape  # two directions displace nothing
    values, precision = np.array([3.0, -2.0, 1.0, 4.0]), np.linalg.inv(covariance)
    best = minimize(
        lambda p: (p - values) @ precision @ (p - values),
        np.zeros(4),
        constraints={"type": "ineq", "fun": lambda p: 1.0 - p @ squared @ p},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert misfit(values, covariance, squared, 1.0) == pytest.approx(best.fun, rel=1e-5)
    assert misfit(values, covariance, squared, 1e3) == 0.0


def test_a_scale_and_a_shift_that_cancel_on_the_object_are_no_faults():
    together = {"depth_scale": -0.006, "pose_error": [0, 0, -0.0024, 0, 0, 0]}
    cancelling = [episode(**together)] * 6
    assert judge("cam_00", cancelling).state is State.RIGHT
    for name, part in together.items():
        assert names(judge("cam_00", [episode(**{name: part})] * 6)) == [name]


def test_what_displaces_by_less_than_a_pixel_rounds_is_no_fault_however_sure():
    small, large = ([episode(pose_error=[x, 0, 0, 0, 0, 0])] * 6 for x in (4e-4, 1.5e-3))
    assert judge("cam_00", small).state is State.RIGHT
    assert names(judge("cam_00", large)) == ["pose_error"]


@pytest.mark.parametrize(("showing", "found"), [(1, False), (3, False), (4, True), (6, True)])
def test_a_fault_must_show_in_most_episodes(showing, found):
    episodes = [episode(clock=0.03)] * showing + [episode()] * (6 - showing)
    finding = judge("cam_00", episodes)
    assert bool(finding.found) is found
    assert all(each.episodes == showing for each in finding.found)


def test_one_episode_that_is_wrongly_sure_accuses_nobody():
    errors = deviations(**WELL, tool_offset=[1.0] * 3, tool_thickness=1.0)
    wild = measured(deviations(depth_scale=0.02), replace_part(errors, "depth_scale", 1e-5))
    assert not judge("cam_00", [wild, *[episode()] * 5]).found


def test_episodes_that_could_not_show_a_fault_do_not_speak_against_it_but_one_alone_is_no_proof():
    errors = deviations(**WELL, tool_offset=[1.0] * 3, tool_thickness=1.0)
    blind = measured(deviations(), replace_part(errors, "clock", 1.0))
    two, one = ([episode(clock=0.03)] * n + [blind] * (6 - n) for n in (2, 1))
    assert names(judge("cam_00", two)) == ["clock"]
    assert not judge("cam_00", one).found and judge("cam_00", one).state is State.CANNOT_BE_JUDGED


def replace_part(errors: np.ndarray, name: str, value: float) -> np.ndarray:
    out = errors.copy()
    out[SLICES[name]] = value
    return out


def test_a_camera_that_sees_no_tool_cannot_be_judged():
    blind = deviations(**WELL, tool_offset=[1.0] * 3, tool_thickness=1.0)
    blind[SLICES["pose_error"]][:2] = 1.0
    far = measured(deviations(pose_error=[0.02, 0, 0, 0, 0, 0]), blind)
    finding = judge("cam_00", [far] * 6)
    assert finding.state is State.CANNOT_BE_JUDGED and not finding.found
    assert finding.unsure_m > 0.01
    assert judge("cam_00", [episode()] * 6).state is State.RIGHT


def test_systematic_errors_are_not_averaged_away():
    """A shift of the outline by what a pixel rounds, in all episodes, is not a pose error."""
    px = 1 / np.sqrt(12)
    design = np.zeros((1, TOTAL + 2 * PATTERNS))
    design[0, SLICES["pose_error"].start], design[0, TOTAL + 3] = 1.0, px * SEEN.pixel_m
    sharp = design.T @ design / 1e-5**2

    def shifted(m: float) -> Episode:
        whole = episode()
        evidence = Evidence(sharp, sharp[:, SLICES["pose_error"].start] * m)
        rest = np.ones(TOTAL + 2 * PATTERNS)
        rest[SLICES["pose_error"].start] = 0
        others = whole.fit.evidence.information * np.outer(rest, rest)
        return replace(whole, fit=replace(whole.fit, evidence=evidence + Evidence(others, 0 * rest)))

    assert judge("cam_00", [shifted(1.5e-3)] * 20).state is State.RIGHT
    assert names(judge("cam_00", [shifted(4e-3)] * 20)) == ["pose_error"]


def facing(turn: float, shift: np.ndarray, own: float = 0.0) -> Episode:
    """Give what a camera sees of a tool that is shifted in its own axes: it takes it for a pose error of its own."""
    c, s = np.cos(turn), np.sin(turn)
    cam_from_tool = np.array([[c, s, 0], [0, 0, -1], [-s, c, 0]])
    rows = np.zeros((3, TOTAL))
    rows[:, SLICES["pose_error"]][:, :3] = -np.eye(3)
    rows[:, SLICES["tool_offset"]] = cam_from_tool
    design = np.hstack([rows, np.zeros((3, 2 * PATTERNS))]) / 2e-4
    seen = (
        design @ np.r_[deviations(tool_offset=shift.tolist(), pose_error=[own, 0, 0, 0, 0, 0]), np.zeros(2 * PATTERNS)]
    )
    known = episode().fit.evidence.information.copy()
    known[SLICES["pose_error"].start :, SLICES["pose_error"].start :][:3, :3] = 0
    known[SLICES["tool_offset"], SLICES["tool_offset"]] = 0
    evidence = Evidence(design.T @ design + known, design.T @ seen)
    return replace(episode(), fit=replace(episode().fit, evidence=evidence))


def test_a_shift_that_all_cameras_share_is_the_tools():
    shift = np.array([0.0, 0.002, -0.002])
    rig = judge_rig({f"cam_{i:02d}": [facing(turn, shift)] * 4 for i, turn in enumerate(np.arange(6.0))})
    assert rig.tool is not None and rig.tool.fault == "tool_offset"
    assert list(rig.tool.values.values()) == pytest.approx(shift.tolist(), abs=2e-4)
    assert not any(finding.found for finding in rig.cameras)


def test_one_camera_of_six_is_not_the_tools_fault():
    still = np.zeros(3)
    rig = judge_rig({f"cam_{i:02d}": [facing(i, still, 0.003 * (i == 2))] * 4 for i in range(6)})
    assert rig.tool is None
    assert [finding.camera for finding in rig.cameras if finding.found] == ["cam_02"]


def test_a_faulty_camera_is_still_found_beside_a_faulty_tool():
    shift = np.array([0.0, 0.002, -0.002])
    rig = judge_rig({f"cam_{i:02d}": [facing(i, shift, 0.004 * (i == 2))] * 4 for i in range(6)})
    assert rig.tool is not None and rig.tool.fault == "tool_offset"
    assert [finding.camera for finding in rig.cameras if finding.found] == ["cam_02"]


def test_a_clock_that_all_cameras_share_is_the_robots():
    rig = judge_rig({f"cam_{i:02d}": [episode(clock=0.03)] * 4 for i in range(3)})
    assert rig.tool is not None and rig.tool.fault == "robot_clock"
    assert rig.tool.values["offset_s"] == pytest.approx(0.03, abs=1e-3)
    assert COUNT == 15 and not any(finding.found for finding in rig.cameras)
