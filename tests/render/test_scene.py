"""Object and tool in one picture: who is in front, how far, and the files that keep it."""

import numpy as np
import pytest
import torch

from plop.errors import PlopError
from plop.gaussians.state import Gaussians, concatenate
from plop.geometry.cameras import Camera, look_at
from plop.geometry.view import MaskLabel, View
from plop.render.pictures.video import VideoWriter
from plop.render.rasterizer.sh import C0
from plop.render.scene import render_scene, tool_above_table
from plop.render.view_file import ViewFile, ViewWriter

CAMERA = Camera(
    "top",
    40,
    40,
    np.array([[100.0, 0, 20], [0, 100, 20], [0, 0, 1]]),
    look_at(np.array([0.0, 0, 0.4]), np.zeros(3), np.array([0.0, 1, 0])),
)


def wall(height_m: float, left_m: float, right_m: float, colour: float) -> Gaussians:
    """An opaque sheet at one height that the camera looks down on."""
    axes = np.arange(left_m, right_m, 0.003), np.arange(-0.05, 0.05, 0.003)
    means = torch.from_numpy(np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)).float()
    means = torch.cat([means, torch.full((len(means), 1), height_m)], 1)
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(len(means), 1)
    scales = torch.tensor([0.003, 0.003, 0.0005]).repeat(len(means), 1)
    sh = torch.full((len(means), 1, 3), (colour - 0.5) / C0)
    return Gaussians(means, quats, scales, torch.full((len(means),), 0.95), sh, torch.arange(len(means)))


def test_the_nearer_one_is_seen_with_its_own_depth():
    (view,) = render_scene(wall(0.0, -0.05, 0.05, 0.8), wall(0.1, 0.0, 0.05, 0.3), [CAMERA])
    assert view.mask[20, 12] == MaskLabel.OBJECT
    assert view.mask[20, 28] == MaskLabel.TOOL
    assert view.depth_m[20, 12] == pytest.approx(0.4, abs=1e-3)
    assert view.depth_m[20, 28] == pytest.approx(0.3, abs=1e-3)
    assert view.rgb[20, 12] == pytest.approx(204, abs=4)
    assert view.rgb[20, 28] == pytest.approx(76, abs=4)
    # At the tool's edge both contribute; an object pixel still has the object's depth.
    assert np.abs(view.depth_m[view.object_mask] - 0.4).max() < 2e-3


def test_the_farther_tool_is_hidden():
    (view,) = render_scene(wall(0.1, -0.05, 0.05, 0.8), wall(0.0, -0.05, 0.05, 0.3), [CAMERA])
    assert not view.tool_mask.any()


def test_the_table_hides_the_part_of_a_tool_that_is_below_it():
    pose = np.eye(4)
    pose[0, 3] = 0.01
    tool = concatenate([wall(0.02, -0.03, 0.0, 0.3), wall(-0.001, 0.0, 0.03, 0.3)])
    placed = tool_above_table(tool, pose, 0.0)
    assert placed.means[:, 2].min() == pytest.approx(0.02)
    assert placed.means[:, 0].max() == pytest.approx(0.01, abs=0.004)
    (view,) = render_scene(wall(0.0, -0.05, -0.04, 0.8), placed, [CAMERA])
    assert view.mask[20, 18] == MaskLabel.TOOL
    assert view.mask[20, 26] == MaskLabel.BACKGROUND
    assert len(tool_above_table(tool, pose, None)) == len(tool)


def test_without_a_tool_only_object_and_background_remain():
    (view,) = render_scene(wall(0.0, -0.05, 0.0, 0.8), None, [CAMERA])
    assert set(np.unique(view.mask)) == {MaskLabel.BACKGROUND, MaskLabel.OBJECT}
    assert (view.depth_m[view.mask == MaskLabel.BACKGROUND] == 0).all()


def test_views_come_back_from_their_file_as_they_went_in(tmp_path):
    views = render_scene(wall(0.0, -0.05, 0.05, 0.8), None, [CAMERA])
    path = tmp_path / "images.h5"
    with ViewWriter(path, name="a", environment="block", frames=2) as writer:
        writer.write_frame(0, views)
        writer.write_frame(1, views)
    with ViewFile(path) as file:
        back = file.view(CAMERA, 1)
        assert (file.name, file.environment, len(file), file.camera_names) == ("a", "block", 2, ["top"])
        for field in ("rgb", "depth_m", "mask"):
            assert np.array_equal(getattr(back, field), getattr(views[0], field))
        with pytest.raises(PlopError, match="another size"):
            file.view(CAMERA.resized(20, 20), 0)
        with pytest.raises(PlopError, match="camera is missing"):
            file.view(Camera("other", 40, 40, CAMERA.intrinsics, CAMERA.world_from_cam), 0)


def test_a_failure_leaves_no_file(tmp_path):
    with pytest.raises(RuntimeError), ViewWriter(tmp_path / "images.h5", name="a", environment="b", frames=1):
        raise RuntimeError("stopped")
    with pytest.raises(RuntimeError), VideoWriter(tmp_path / "v.mp4", rate_hz=5) as video:
        video.append(np.zeros((32, 32, 3), np.uint8))
        raise RuntimeError("stopped")
    assert list(tmp_path.iterdir()) == []


def test_a_video_plays_back_what_was_written(tmp_path):
    import imageio.v3 as iio

    with VideoWriter(tmp_path / "v.mp4", rate_hz=5) as video:
        for level in (0, 100, 200):
            video.append(np.full((32, 48, 3), level, np.uint8))
    frames = iio.imread(tmp_path / "v.mp4")
    assert frames.shape == (3, 32, 48, 3)
    assert frames.mean((1, 2, 3)) == pytest.approx([0, 100, 200], abs=4)
    assert iio.immeta(tmp_path / "v.mp4")["fps"] == 5


def test_a_view_of_another_kind_of_pixel_is_kept(tmp_path):
    view = View(CAMERA, np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40)), np.full((40, 40), MaskLabel.UNKNOWN))
    with ViewWriter(tmp_path / "i.h5", name="a", environment="b", frames=1) as writer:
        writer.write_frame(0, [view])
    with ViewFile(tmp_path / "i.h5") as file:
        assert file.view(CAMERA, 0).depth_m.dtype == np.float32
        assert (file.view(CAMERA, 0).mask == MaskLabel.UNKNOWN).all()
