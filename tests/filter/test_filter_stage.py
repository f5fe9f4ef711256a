"""The filter stage: what it stores."""

from __future__ import annotations

import json

import pytest
import torch

from plop.dynamics.filter.particle_filter import UpdateConfig
from plop.errors import PlopError
from plop.gaussians.trajectory import Trajectory
from plop.pipeline.stage import Input, Output
from stages.filter.stage import FilterConfig, run
from tests.support.small_episode import FRAMES, write_set


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    recordings, init = write_set(tmp_path_factory.mktemp("set"), train=1, test=1)
    return {"recordings": Input(recordings), "init": Input(init)}


def test_prediction_update_and_innovation_are_kept(inputs, tmp_path):
    config = FilterConfig(split="test", update=UpdateConfig(iterations=6, views=1, cells_across=4))
    summary = run(inputs, config, Output(tmp_path))
    assert summary.figures["episodes"] == 1
    with Trajectory(tmp_path / "episode_1.h5") as trajectory:
        assert trajectory.frames("predicted") == list(range(1, FRAMES))
        assert trajectory.frames("updated") == list(range(FRAMES))  # the first frame is settled, not predicted
        before, after = trajectory.read("predicted", 4), trajectory.read("updated", 4)
        update = trajectory.extra("updated", 4, "update")
    torch.testing.assert_close(before.means + update, after.means)
    told = json.loads((tmp_path / "episode_1.json").read_text())
    assert set(told["frames"][0]["cameras"]) == {"cam0", "cam1", "cam2"}
    assert summary.figures["updated_l1"] < summary.figures["l1"]


@pytest.mark.parametrize(
    ("exclude", "problem"), [(("cam7",), "no such camera"), (("cam0", "cam1", "cam2"), "are excluded")]
)
def test_excluded_cameras_are_checked_before_work_begins(inputs, tmp_path, exclude, problem):
    with pytest.raises(PlopError, match=problem) as caught:
        run(inputs, FilterConfig(exclude=exclude), Output(tmp_path))
    assert caught.value.where == "filter.exclude" and not list(tmp_path.glob("*.h5"))
