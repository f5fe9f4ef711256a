"""A tool's friction holds what it presses, until Coulomb's law lets it slip."""

from __future__ import annotations

import numpy as np
import pytest

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.solver import EngineTrajectory, simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.shapes import Shape, whole_body
from plop.physics.scenes.tools import box_mesh, cylinder_mesh

TOP_M, DEPTH_M, DOWN_S, AWAY_S = 0.024, 0.0025, 0.1, 0.3
BODY = whole_body(Shape("block", (0.056, 0.040, TOP_M)), 0.008)


def dragged(friction: float, aside_m: float, *, start=BODY.particles, times=None) -> EngineTrajectory:
    """Press a plate wider than a block into it, hold, and move the plate aside."""
    frames = np.arange(0, 0.71, 0.02)
    poses = np.tile(np.eye(4), (len(frames), 1, 1))
    poses[:, 2, 3] = np.interp(frames, [0, DOWN_S], [TOP_M + 0.0005, TOP_M - DEPTH_M])
    poses[:, 0, 3] = np.interp(frames, [AWAY_S, AWAY_S + 0.2], [0, aside_m])
    tool = ToolMotion(*box_mesh((0.15, 0.10, 0.02)), frames, poses)
    material = Material(2e4, 0.4, table_friction=10.0, tool_friction=friction, damping_per_s=8.0)
    return simulate(start, material, tool, frames if times is None else frames[times], EngineConfig(dx_m=0.016))


def top_followed_m(run: EngineTrajectory) -> float:
    top = BODY.particles.positions[:, 2] > TOP_M - 1e-6
    return float((run.positions[-1] - run.positions[0])[top, 0].mean())


@pytest.mark.parametrize("friction, share", [(0.0, 0.0), (4.0, 1.0)])
def test_the_surface_follows_a_rough_plate_and_no_smooth_one(friction: float, share: float):
    assert top_followed_m(dragged(friction, 0.003)) == pytest.approx(0.003 * share, abs=0.0003)


def test_what_slips_is_rubbed_with_the_coefficient():
    force = dragged(0.2, 0.030).tool_force[22:25].mean(0)
    assert force[0] / -force[2] == pytest.approx(0.2, rel=0.1)


def test_a_run_that_goes_on_still_holds():
    whole = dragged(4.0, 0.003)
    first = dragged(4.0, 0.003, times=slice(0, 20))
    rest = dragged(4.0, 0.003, start=first.final, times=slice(19, None))
    assert np.abs(rest.positions[-1] - whole.positions[-1]).max() < 1e-4


PUNCHES = {"box": box_mesh((0.02, 0.02, 0.024)), "cylinder": cylinder_mesh(0.012, 0.024)}


def driven(friction: float, punch: str, spacing_m: float, times, depth_m, aside_m) -> np.ndarray:
    """Drive a punch narrower than a block into it and over it; force on the block at the frames, [T, 3] [N]."""
    block = whole_body(Shape("block", (0.060, 0.040, 0.040)), spacing_m)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, 2, 3] = 0.040 - np.asarray(depth_m)
    poses[:, 0, 3] = aside_m
    material = Material(2e4, 0.4, table_friction=10.0, tool_friction=friction, damping_per_s=2.0)
    tool = ToolMotion(*PUNCHES[punch], times, poses)
    return simulate(block.particles, material, tool, times, EngineConfig(dx_m=2 * spacing_m)).tool_force


def pressed_and_dragged(friction: float, punch: str, spacing_m: float) -> np.ndarray:
    """Press a punch and drag it across the middle; force at the frames of the drag, [T, 3] [N]."""
    times = np.arange(0, 0.5, 0.02)
    depth_m, aside_m = np.interp(times, [0, 0.1], [-0.0005, 0.004]), np.interp(times, [0.2, 0.4], [-0.005, 0.005])
    return driven(friction, punch, spacing_m, times, depth_m, aside_m)[11:]


@pytest.mark.parametrize("punch", PUNCHES)
@pytest.mark.parametrize("spacing_m", [0.0045, 0.0065])
def test_a_smooth_punch_slides_over_a_block_and_does_not_plough(punch: str, spacing_m: float):
    smooth, rough = (pressed_and_dragged(friction, punch, spacing_m) for friction in (0.0, 0.3))
    assert abs(smooth[:, 0].sum() / smooth[:, 2].sum()) < 0.01, "the same way to both sides of the middle takes no work"
    aside, down = np.linalg.norm(rough[:, :2], axis=1), -rough[:, 2]
    assert aside.sum() / down.sum() < 0.3 * 1.05
    if (punch, spacing_m) != ("box", 0.0065):
        assert (aside / down).max() < 0.3 * 1.05
    # particles come under an edge one after the other: with normals of faces only there would be no force at all
    assert (np.linalg.norm(smooth[:, :2], axis=1) / -smooth[:, 2]).max() < 0.06


@pytest.mark.parametrize("punch", PUNCHES)
@pytest.mark.parametrize("spacing_m", [0.0045, 0.0065])
def test_what_rises_behind_a_rough_punch_pushes_it_on(punch: str, spacing_m: float):
    """Finite elements (Drake, MuJoCo) give lateral forces of 0.8 of what friction alone would be."""
    times = np.arange(0, 0.7, 0.02)
    depth_m, aside_m = np.interp(times, [0, 0.1], [-0.0005, 0.004]), np.interp(times, [0.2, 0.6], [-0.008, 0.012])
    force = driven(0.54, punch, spacing_m, times, depth_m, aside_m)[21:31]
    assert 0.8 < np.linalg.norm(force[:, :2], axis=1).sum() / -force[:, 2].sum() / 0.54 < 0.95
