"""Motions like recorded ones: elsewhere, turned, faster or slower, less far or farther."""

import numpy as np
import pytest

from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.tools import box_mesh
from plop.physics.scenes.varied_motion import Variation, VariationRanges, another_motion, varied

STEP_S = 0.04
OBJECT = np.stack(np.meshgrid(*[np.linspace(0.0, e, 5) for e in (0.06, 0.04, 0.03)]), -1).reshape(-1, 3)
MIDDLE = np.array([0.03, 0.02])
SAME = Variation(reach=1.0, speed=1.0, turn_rad=0.0, aside_m=(0.0, 0.0))


def push(first_x: float = -0.02) -> ToolMotion:
    """Down beside the object, then 20 mm along x."""
    places = [[first_x, 0.02, 0.02 - 0.005 * k] for k in range(4)] + [
        [first_x + 0.004 * k, 0.02, 0.005] for k in range(1, 6)
    ]
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    return ToolMotion(*box_mesh((0.01, 0.02, 0.03)), 1.5 + STEP_S * np.arange(len(places)), poses)


def test_nothing_changed_is_the_recorded_motion():
    found = varied(push(), OBJECT, SAME)
    assert found.world_from_tool == pytest.approx(push().world_from_tool, abs=1e-12)
    assert found.times == pytest.approx(push().times)


def test_reach_lengthens_the_way_along_the_table_and_leaves_heights():
    found = varied(push(), OBJECT, Variation(1.5, 1.0, 0.0, (0.0, 0.0)))
    assert found.world_from_tool[:, 2, 3] == pytest.approx(push().world_from_tool[:, 2, 3])
    assert np.ptp(found.world_from_tool[:, 0, 3]) == pytest.approx(1.5 * np.ptp(push().world_from_tool[:, 0, 3]))


@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_speed_shortens_the_episode_at_the_same_frame_rate(speed):
    found = varied(push(), OBJECT, Variation(1.0, speed, 0.0, (0.0, 0.0)))
    assert np.diff(found.times) == pytest.approx(STEP_S)
    assert np.ptp(found.times) == pytest.approx(np.ptp(push().times) / speed)
    assert found.world_from_tool[-1] == pytest.approx(push().world_from_tool[-1])
    fastest = np.abs(np.diff(found.world_from_tool[:, 0, 3])).max() / STEP_S
    assert fastest == pytest.approx(speed * 0.004 / STEP_S, rel=1e-6)


def test_a_turn_is_about_the_middle_of_the_object():
    found = varied(push(), OBJECT, Variation(1.0, 1.0, np.pi / 2, (0.002, -0.003)))
    before, after = (m.world_from_tool[:, :2, 3] for m in (push(), found))
    turned = (before - MIDDLE) @ np.array([[0, 1], [-1, 0]])
    assert after == pytest.approx(turned + MIDDLE + [0.002, -0.003])
    assert found.world_from_tool[0, :3, 0] == pytest.approx([0, 1, 0], abs=1e-12)


def test_drawn_motions_stay_within_their_ranges_and_do_not_begin_inside_the_object():
    ranges, random = VariationRanges(reach=1.6, speed=1.4, turn_deg=20.0), np.random.default_rng(0)
    recorded = push(first_x=-0.0065)  # 1.5 mm before the object
    found = [another_motion(recorded, OBJECT, ranges, random) for _ in range(40)]
    ways = [np.linalg.norm(np.diff(m.world_from_tool[[0, -1], :2, 3], axis=0)) / 0.02 for m in found]
    headings = np.degrees([np.arctan2(m.world_from_tool[0, 1, 0], m.world_from_tool[0, 0, 0]) for m in found])
    lasting = [np.ptp(m.times) / np.ptp(recorded.times) for m in found]
    assert 0.49 < min(ways) < 0.8 and 1.3 < max(ways) < 1.61
    assert 0.65 < min(lasting) < 0.85 and 1.2 < max(lasting) < 1.5
    assert np.abs(headings).max() <= 20.0 and 8 < (headings == 0).sum() < 40
    for motion in found:
        pose = motion.world_from_tool[0]
        local = np.abs((OBJECT - pose[:3, 3]) @ pose[:3, :3] - [0, 0, 0.015])
        assert not (local <= [0.005, 0.01, 0.015]).all(1).any()


def test_a_seed_gives_the_same_motion():
    ranges = VariationRanges(1.6, 1.4, 20.0)
    one, two = (another_motion(push(), OBJECT, ranges, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.world_from_tool, two.world_from_tool)
