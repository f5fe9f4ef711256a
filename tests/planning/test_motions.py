"""The family of motions: what each change does to a path, and where it makes no sense."""

from __future__ import annotations

import numpy as np
import pytest

from plop.planning.motions import REST_S, Change, planned_episode
from plop.tracking.hidden_points import tool_distance
from tests.support.coarse_episodes import coarse_episode

PRESS, PUSH = 0, 1


def length_s(episode):
    return float(np.ptp(episode.times))


@pytest.mark.parametrize(("change", "factor"), [(Change.SLOWER, 2.0), (Change.FASTER, 0.5)])
@pytest.mark.parametrize("k", [PRESS, PUSH])
def test_speed_changes_the_time_and_not_the_path(k, change, factor):
    like = coarse_episode(k)
    found = planned_episode(like, change)
    step_s = np.diff(like.times)[0]
    assert length_s(found) == pytest.approx(factor * length_s(like), abs=1.5 * step_s)
    for end in (0, -1):
        assert np.allclose(found.tool.world_from_tool[end], like.tool.world_from_tool[end], atol=2e-3)
    assert found.points.shape == (len(found.times), *like.points.shape[1:])


def test_a_press_goes_deeper_a_push_does_not():
    like = coarse_episode(PRESS)
    found = planned_episode(like, Change.DEEPER)
    fall, before = (np.ptp(e.tool.world_from_tool[:, 2, 3]) for e in (found, like))
    assert fall == pytest.approx(4 / 3 * before)
    assert planned_episode(coarse_episode(PUSH), Change.DEEPER) is None


def test_a_push_goes_farther_and_comes_from_the_opposite_side_a_press_does_not():
    like = coarse_episode(PUSH)
    way = like.tool.world_from_tool[-1, :2, 3] - like.tool.world_from_tool[0, :2, 3]
    farther, reversed_ = planned_episode(like, Change.FARTHER), planned_episode(like, Change.REVERSED)
    for found, factor in ((farther, 1.5), (reversed_, -1.0)):
        moved = found.tool.world_from_tool[-1, :2, 3] - found.tool.world_from_tool[0, :2, 3]
        assert np.allclose(moved, factor * way, atol=1e-9)
    assert planned_episode(coarse_episode(PRESS), Change.FARTHER) is None
    assert planned_episode(coarse_episode(PRESS), Change.REVERSED) is None


def test_a_rest_is_added_where_the_tool_is_lowest():
    like = coarse_episode(PRESS)
    found = planned_episode(like, Change.RESTING)
    assert length_s(found) == pytest.approx(length_s(like) + REST_S, abs=np.diff(like.times)[0])
    heights = found.tool.world_from_tool[:, 2, 3]
    assert (heights < heights.min() + 1e-6).sum() >= round(REST_S / np.diff(like.times)[0])


@pytest.mark.parametrize("change", [c for c in Change if c != Change.NONE])
@pytest.mark.parametrize("k", [PRESS, PUSH])
def test_no_motion_begins_in_the_object(k, change):
    found = planned_episode(coarse_episode(k), change)
    if found is not None:
        assert tool_distance(found.tool, 0, found.points[0]).min() > 0
