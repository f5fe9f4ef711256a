"""The rollout stage with a model whose prediction is known."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

import stages.rollout.stage as stage
from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.resampling import ResamplingConfig, resample
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat, write_splat
from plop.gaussians.trajectory import Trajectory
from plop.pipeline.stage import Output
from plop.recordings.set import RecordingSet
from plop.render.view_file import ViewFile
from tests.support.block_scene import STEP_M, Parting, make_inputs, parted


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return make_inputs(tmp_path_factory.mktemp("block"), names=("a", "b"))


@pytest.fixture
def run(inputs, tmp_path, monkeypatch):
    def rolled(model=None, out="out", inputs=inputs, **config):
        monkeypatch.setattr(stage, "load_model", lambda folder, device: model or Parting())
        (tmp_path / out).mkdir(exist_ok=True)
        return stage.STAGE.run(inputs, stage.RolloutConfig(**{"jobs": 1, **config}), Output(tmp_path / out))

    return rolled


def files(folder: Path) -> dict[str, bytes]:
    found = (path for path in sorted(folder.rglob("*")) if path.is_file() and ".done" not in path.parts)
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def test_states_and_views_are_those_of_the_model(run, inputs, tmp_path):
    summary = run(animation=True)
    start = read_splat(inputs["init"].path / "a" / "object.ply")
    with Trajectory(tmp_path / "out" / "a" / "states.h5") as states:
        assert states.frames("states") == [0, 1, 2, 3]
        assert torch.allclose(states.read("states", 3).means, parted(start, 3).means, atol=1e-6)
    recordings = RecordingSet.load(inputs["recordings"].path)
    with recordings.open("a") as recording, ViewFile(tmp_path / "out" / "a" / "images.h5") as views:
        for name in recording.camera_names:
            measured = recording.view(name, 3)
            predicted = views.view(measured.camera, 3)
            assert (measured.mask == predicted.mask).mean() > 0.999
            assert np.abs(measured.rgb.astype(int) - predicted.rgb).max() <= 2
    assert len(list((tmp_path / "out" / "a" / "animation").glob("*.ply"))) == 4
    assert summary.figures["episodes"] == 2
    assert {row["episode"] for row in summary.table} == {"a", "b"}
    assert summary.figures["step_ms_median"] > 0


class Splitting(ConstantVelocity):
    """A model that moves nothing and splits two Gaussians in every step."""

    def step(self, state, action, *, generator=None):
        config = ResamplingConfig(split_above=1.0, merge_below=0.0, max_count=len(state.side) + 2)
        after = ConstantVelocity(keep=0).step(state, action)
        stretched = after.gaussians.scales * torch.tensor([1.3, 1.0, 1.0])
        return resample(replace(after, gaussians=after.gaussians.with_(scales=stretched)), config, generator=generator)


def test_merges_and_splits_are_counted_by_frame_and_episode(run, tmp_path):
    table = run(model=Splitting(), episodes="a").table
    assert (table[0]["splits"], table[0]["merges"]) == (6, 0)
    assert table[0]["gaussians_last"] == table[0]["gaussians_first"] + 6
    with Trajectory(tmp_path / "out" / "a" / "states.h5") as states:
        assert [int(states.extra("states", frame, "splits")) for frame in range(4)] == [0, 2, 2, 2]


def test_the_video_has_every_frame_side_by_side(run, tmp_path):
    import imageio.v3 as iio

    run(episodes="a")
    frames = iio.imread(tmp_path / "out" / "a" / "video.mp4")
    assert len(frames) == 4
    height, width = frames.shape[1:3]
    assert width > 2.5 * height
    assert height >= 384 and height % 2 == width % 2 == 0
    still = iio.imread(tmp_path / "out" / "a" / "still.png")
    assert still.shape == frames[0].shape
    assert min(np.abs(still.astype(int) - frame).mean() for frame in frames) < 3, "one of the frames"


def red_share(picture: np.ndarray) -> float:
    """Share of a comparison's last panel that is drawn orange to dark red, as far away."""
    third = picture[72:, 2 * picture.shape[1] // 3 : -110].astype(int)
    return float((third[..., 0] - third[..., 2] > 120).mean())


def test_a_wrong_prediction_is_red_and_a_right_one_is_not(run, tmp_path):
    import imageio.v3 as iio

    run(episodes="a")
    run(ConstantVelocity(keep=0), out="still", episodes="a")
    right, wrong = (iio.imread(tmp_path / out / "a" / "still.png") for out in ("out", "still"))
    assert red_share(right) < 0.001 < 0.01 < red_share(wrong)


def test_the_model_sees_the_actions_of_the_recording(run, inputs):
    model = Parting()
    run(model, episodes="a")
    with RecordingSet.load(inputs["recordings"].path).open("a") as recording:
        poses = torch.from_numpy(recording.world_from_tool).float()
    assert [action.dt_s for action in model.seen] == pytest.approx([0.1] * 3)
    for step, action in enumerate(model.seen):
        assert torch.equal(action.world_from_tool, poses[step])
        assert torch.equal(action.next_world_from_tool, poses[step + 1])
        assert action.table_z_m is None


def test_measured_images_after_frame_0_do_not_reach_the_prediction(run, tmp_path):
    blind = make_inputs(tmp_path / "blind")
    run(out="seeing", inputs=blind)
    with h5py.File(tmp_path / "blind" / "recordings" / "episodes" / "a.h5", "a") as file:
        for camera in file["cameras"].values():
            for key in ("rgb", "depth_m", "mask"):
                camera[key][1:] = 0
        del file["truth"]
    run(out="blind-run", inputs=blind)
    seeing, unseeing = files(tmp_path / "seeing"), files(tmp_path / "blind-run")
    for name in ("a/states.h5", "a/images.h5"):
        assert seeing[name] == unseeing[name]
    assert seeing["a/video.mp4"] != unseeing["a/video.mp4"]


def test_two_runs_give_the_same_bytes(run, tmp_path):
    run(out="first", episodes="a")
    run(out="second", episodes="a")
    assert files(tmp_path / "first") == files(tmp_path / "second")


def test_a_finished_episode_is_not_done_again(run, tmp_path):
    run(episodes="a")
    before = (tmp_path / "out" / "a" / "states.h5").stat().st_mtime_ns
    model = Parting()
    run(model)
    assert model.calls == 3, "only b has work left"
    assert (tmp_path / "out" / "a" / "states.h5").stat().st_mtime_ns == before


def test_a_broken_prediction_names_the_frame_and_leaves_no_file(run, tmp_path):
    with pytest.raises(PlopError) as caught:
        run(Parting(spoil_at=2), episodes="a")
    assert "a, frame 2" in caught.value.where
    assert "means" in caught.value.problem
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == []


def test_an_episode_without_a_fit_is_named(run, inputs, tmp_path):
    other = make_inputs(tmp_path / "other", names=("a", "c"))
    (other["init"].path / "c" / "tool.ply").unlink()
    with pytest.raises(PlopError, match="no fitted Gaussians") as caught:
        run(inputs=other)
    assert "c" in caught.value.where


def test_a_fit_of_another_object_is_refused(run, tmp_path):
    other = make_inputs(tmp_path / "other")
    path = other["init"].path / "a" / "object.ply"
    fit = read_splat(path)
    write_splat(path, fit.with_(means=fit.means + torch.tensor([0.1, 0, 0])))
    with pytest.raises(PlopError, match="another object"):
        run(inputs=other)


def test_a_model_of_another_environment_is_refused_unless_allowed(run, tmp_path):
    other = make_inputs(tmp_path / "other")
    facts = {"schema": 1, "training": {"environment": "sphere"}}
    (other["model"].path / "model.json").write_text(json.dumps(facts))
    with pytest.raises(PlopError, match="another object"):
        run(inputs=other)
    assert run(inputs=other, other_environment=True).figures["episodes"] == 1


@pytest.mark.parametrize("config", [{"split": "train"}, {"episodes": "z*"}, {"video_camera": "top"}])
def test_a_choice_that_is_not_there_is_an_error(run, config):
    with pytest.raises(PlopError):
        run(**config)


def test_empty_masks_at_frame_0_are_an_error(run, tmp_path):
    other = make_inputs(tmp_path / "other")
    with h5py.File(other["recordings"].path / "episodes" / "a.h5", "a") as file:
        for camera in file["cameras"].values():
            camera["mask"][0] = 0
    with pytest.raises(PlopError, match="No camera sees the object"):
        run(inputs=other)


def test_persistence_keeps_every_gaussian(run, inputs, tmp_path):
    run(ConstantVelocity(keep=0), episodes="a")
    start = read_splat(inputs["init"].path / "a" / "object.ply")
    with Trajectory(tmp_path / "out" / "a" / "states.h5") as states:
        assert torch.equal(states.read("states", 3).means, start.means)
    assert STEP_M > 0
