"""ingest droid: good episodes, what the user brings along, and input that is refused."""

from __future__ import annotations

import json
import shutil
from datetime import datetime

import cv2
import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.geometry.view import MaskLabel
from plop.recordings.readers.droid.writer import write_video
from stages.ingest.masks import GeometricMasker, MaskRules, Picture
from tests.ingest.droid_runs import edit, episode_of, ingest, said
from tests.support.droid_scene import (
    EXT1,
    EXT2,
    TABLE_Z,
    WORKSPACE,
    WRIST,
    Scene,
    exterior_poses,
    flange_path,
    knife,
    make_episode,
    world_from_tool,
    wrist_offset,
)


def test_a_good_episode_becomes_a_recording(raw, tmp_path):
    summary, recordings = ingest(raw, tmp_path / "out")
    assert summary.warnings == [] and recordings.environment == "SIM" and summary.figures["frames"] == 12
    scene = Scene()
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT1, EXT2] and recording.scan_names == [WRIST]
        assert recording.table_z_m == TABLE_Z and recording.scan_length(WRIST) == 5
        assert np.allclose(np.diff(recording.time_s), 0.067) and recording.time_s[0] == 0
        assert np.allclose(recording.world_from_tool, world_from_tool(flange_path(12)), atol=1e-9)
        view = recording.view(EXT2, 3)
        rgb, depth, _ = scene.render(view.camera.world_from_cam, recording.world_from_tool[3])
        assert np.allclose(view.camera.world_from_cam, exterior_poses()[EXT2], atol=1e-9)
        assert np.allclose(view.camera.intrinsics, scene.intrinsics)
        assert np.abs(view.depth_m - depth).max() <= 0.00051
        assert np.abs(view.rgb.astype(int) - rgb).mean() < 6
        scan = recording.view(WRIST, 2, group="scan")
        assert np.allclose(scan.camera.world_from_cam, pose_from_euler_xyz(flange_path(12)[2]) @ wrist_offset())


def test_the_same_input_gives_the_same_bytes_and_a_second_run_does_nothing(raw, tmp_path):
    _, one = ingest(raw, tmp_path / "a")
    _, two = ingest(raw, tmp_path / "b")
    assert one.path(one.names[0]).read_bytes() == two.path(two.names[0]).read_bytes()
    before = one.path(one.names[0]).stat().st_mtime_ns
    ingest(raw, tmp_path / "a")
    assert one.path(one.names[0]).stat().st_mtime_ns == before
    assert str(tmp_path) not in (tmp_path / "a" / "episodes.json").read_text()


def test_masks_agree_with_the_truth():
    scene = Scene(160, 120, 150.0)
    masker = GeometricMasker(np.array([WORKSPACE["min"], WORKSPACE["max"]]), TABLE_Z, knife(), MaskRules())
    rng = np.random.default_rng(0)
    for pose in exterior_poses().values():
        for flange in flange_path(4):
            tool = world_from_tool(flange)
            rgb, depth, truth = scene.render(pose, tool)
            depth = depth + 0.002 * rng.standard_normal(depth.shape).astype(np.float32) * (depth > 0)
            mask = masker.mask(Picture(scene.camera(pose), rgb, depth, tool, pose_from_euler_xyz(flange)))
            ours, theirs = mask == MaskLabel.OBJECT, truth == MaskLabel.OBJECT
            assert (ours & theirs).sum() / (ours | theirs).sum() >= 0.9
            assert (ours & (truth == MaskLabel.TOOL)).mean() < 0.001


def test_a_second_camera_is_enough_and_sizes_shrink(raw, tmp_path):
    _, recordings = ingest(raw, tmp_path / "out", size=32)
    with recordings.open(recordings.names[0]) as recording:
        camera = recording.camera(EXT1, 0)
        assert (camera.width, camera.height) == (32, 24) and np.isclose(camera.intrinsics[0, 0], 30)


# The bad cases, numbered as in the description of the raw format.


def test_external_links_are_not_followed(raw, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.zeros((12, 6))
    with edit(raw) as file:
        del file["observation/robot_state/cartesian_position"]
        file["observation/robot_state/cartesian_position"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "x")
    with pytest.raises(PlopError, match="contains a link into another file"):
        ingest(raw, tmp_path / "out")


def test_extrinsics_in_millimetres_are_refused(raw, tmp_path):
    with edit(raw) as file:
        for serial in (EXT1, EXT2):
            file[f"observation/camera_extrinsics/{serial}_left"][:, :3] *= 1000
    with pytest.raises(PlopError, match="does not seem to be in metres"):
        ingest(raw, tmp_path / "out")


def test_an_object_outside_the_workspace_is_named(tmp_path):
    box = {"min": [-0.6, -0.15, 0.0], "max": [-0.3, 0.15, 0.3]}
    make_episode(tmp_path / "raw", rows=5, serials=(EXT1,), notes={"workspace": box})
    with pytest.raises(PlopError, match="outside the workspace.*points around"):
        ingest(tmp_path / "raw", tmp_path / "out")


def test_empty_masks_are_named(tmp_path):
    make_episode(tmp_path / "raw", rows=5, serials=(EXT1,), notes={"table_z": 0.2})
    with pytest.raises(PlopError, match="masks are empty.*table_z"):
        ingest(tmp_path / "raw", tmp_path / "out")


def test_an_episode_whose_tool_never_touches_is_skipped(raw, tmp_path):
    make_episode(
        raw,
        rows=6,
        serials=(EXT1,),
        flange6=flange_path(6, low=0.25, high=0.35),
        moment=datetime(2023, 8, 6, 22, 15, 4),
    )
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, "tool never touches", "frame 5", "flange_from_tool") and len(recordings.skipped) == 1
    summary, recordings = ingest(raw, tmp_path / "kept", keep_untouched=True)
    assert not recordings.skipped and not said(summary, "never touches")


def test_a_tool_that_never_touches_in_any_episode_is_an_error(tmp_path):
    make_episode(tmp_path / "raw", rows=6, serials=(EXT1,), flange6=flange_path(6, low=0.25, high=0.35))
    with pytest.raises(PlopError, match="tool never touches.*frame 5"):
        ingest(tmp_path / "raw", tmp_path / "out")


def test_a_black_camera_is_left_out(raw, tmp_path):
    write_video(episode_of(raw) / "recordings/MP4" / f"{EXT1}.mp4", [np.zeros((48, 64, 3), np.uint8)] * 12)
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "single colour", "left out")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT2]


def test_no_depth_names_the_three_ways(raw, tmp_path):
    shutil.rmtree(episode_of(raw) / "recordings/depth")
    with pytest.raises(PlopError, match=r"no depth.*\(one eye\).*Export depth as 16-bit PNG.*stereo video"):
        ingest(raw, tmp_path / "out")


def test_no_intrinsics_unless_the_user_brings_them(tmp_path):
    make_episode(tmp_path / "raw", intrinsics=False, rows=5)
    with pytest.raises(PlopError, match="no intrinsics"):
        ingest(tmp_path / "raw", tmp_path / "a")
    summary, recordings = ingest(
        tmp_path / "raw", tmp_path / "b", cameras__exterior_focal_px=1200.0, cameras__wrist_focal_px=1200.0
    )
    assert said(summary, "assumed", "plop calibrate")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera(EXT1, 0).intrinsics[0, 0] == 60
    side = {"SIM+abcd1234+2023-08-06-22h-13m-04s": {s: [60.0, 31.5, 60.0, 23.5] for s in (EXT1, EXT2, WRIST)}}
    (tmp_path / "raw" / "intrinsics.json").write_text(json.dumps(side))
    _, recordings = ingest(tmp_path / "raw", tmp_path / "c")
    with recordings.open(recordings.names[0]) as recording:
        assert np.allclose(recording.camera(EXT1, 0).intrinsics, Scene().intrinsics)


def test_the_scan_may_be_an_episode_of_its_own(tmp_path):
    raw = tmp_path / "raw"
    scan = make_episode(raw, rows=8, moment=datetime(2023, 8, 6, 22, 0, 0), serials=(EXT1, WRIST))
    make_episode(raw, rows=6, notes={"scan_episode": scan.relative_to(raw).as_posix()})
    _, recordings = ingest(raw, tmp_path / "out", rows__scan_frames=4, episodes=("*-22h-13m-*",))
    with recordings.open(recordings.names[0]) as recording:
        assert recording.scan_length(WRIST) == 4 and len(recording) == 6


def test_masks_made_elsewhere(raw, tmp_path):
    name = "SIM_2023-08-06-22h-13m-04s"
    for serial in (EXT1, EXT2, WRIST):
        (tmp_path / "masks" / name / serial).mkdir(parents=True)
        for frame in range(12):
            picture = np.zeros((48, 64), np.uint8)
            picture[20:30, 25:40] = 255
            cv2.imwrite(str(tmp_path / "masks" / name / serial / f"{frame:06d}.png"), picture)
    with pytest.raises(PlopError, match="--binary-masks"):
        ingest(raw, tmp_path / "a", masks=tmp_path / "masks")
    _, recordings = ingest(raw, tmp_path / "b", masks=tmp_path / "masks", binary_masks=True)
    with recordings.open(recordings.names[0]) as recording:
        assert recording.view(EXT1, 5).object_mask.sum() == 150
    (tmp_path / "masks" / name / EXT1 / "000007.png").unlink()
    with pytest.raises(PlopError, match="000007.png"):
        ingest(raw, tmp_path / "c", masks=tmp_path / "masks", binary_masks=True)


def test_split_by_episode(tmp_path):
    for minute in range(3):
        make_episode(tmp_path / "raw", rows=5, serials=(EXT1,), moment=datetime(2023, 8, 6, 22, minute, 0))
    _, recordings = ingest(tmp_path / "raw", tmp_path / "a")
    assert (len(recordings.train), recordings.test) == (2, ["SIM_2023-08-06-22h-02m-00s"])
    _, recordings = ingest(tmp_path / "raw", tmp_path / "b", test=("*-00m-*",))
    assert recordings.test == ["SIM_2023-08-06-22h-00m-00s"]
    for setting in ("test", "episodes"):
        with pytest.raises(PlopError, match="no episode of this name") as caught:
            ingest(tmp_path / "raw", tmp_path / "c", **{setting: ("SIM_2023-08-06-22h-00m-0s", "*")})
        assert "SIM_2023-08-06-22h-00m-00s" in caught.value.fix and f"--{setting} " in caught.value.found
    summary, _ = ingest(tmp_path / "raw", tmp_path / "d", test=("*-07m-*",))
    assert said(summary, "--test *-07m-* matches no episode") and said(summary, "no usable episode is a test episode")
    with pytest.raises(PlopError, match="No episode is selected"):
        ingest(tmp_path / "raw", tmp_path / "c", outcome="failure")
