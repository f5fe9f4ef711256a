"""ingest droid: every bad case that real data has, by its number in the format notes."""

from __future__ import annotations

import json
import shutil
from datetime import datetime
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.recordings.readers.droid.writer import write_video
from tests.ingest.droid_runs import edit, episode_of, ingest, said
from tests.support.droid_scene import EXT1, EXT2, Scene, exterior_poses, flange_path, make_episode, world_from_tool


def test_case_01_no_recordings_is_skipped_and_the_rest_goes_on(raw, tmp_path):
    other = raw / "SIM/success/2023-08-06/Sun_Aug__6_23:00:00_2023"
    shutil.copytree(episode_of(raw), other)
    shutil.rmtree(other / "recordings")
    summary, recordings = ingest(raw, tmp_path / "out")
    assert summary.figures["skipped"] == 1 and len(recordings.names) == 1
    assert "recordings" in recordings.skipped["SIM_2023-08-06-23h-00m-00s"]


def test_case_01_a_missing_video_leaves_that_camera_out(raw, tmp_path):
    (episode_of(raw) / "recordings/MP4" / f"{EXT1}.mp4").unlink()
    summary, recordings = ingest(raw, tmp_path / "out")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT2]
    assert said(summary, EXT1, "no video", f"{EXT1}.mp4")


def test_case_01_no_fixed_camera_at_all_is_an_error(raw, tmp_path):
    for serial in (EXT1, EXT2):
        (episode_of(raw) / "recordings/MP4" / f"{serial}.mp4").unlink()
    with pytest.raises(PlopError, match="No fixed camera"):
        ingest(raw, tmp_path / "out")


def test_case_01_only_svo_files_say_so(raw, tmp_path):
    recordings = episode_of(raw) / "recordings"
    for serial in (EXT1, EXT2):
        (recordings / "MP4" / f"{serial}.mp4").unlink()
        (recordings / f"{serial}.svo").write_bytes(b"x")
    with pytest.raises(PlopError, match=f"only {EXT1}.svo"):
        ingest(raw, tmp_path / "out")


def test_case_02_no_time_stamps(raw, tmp_path):
    for path in (episode_of(raw) / "recordings/MP4").glob("*_timestamps.json"):
        path.unlink()
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, "_timestamps.json", "row i is taken as frame i")
    with recordings.open(recordings.names[0]) as recording:
        assert len(recording) == 12


def _without_frames(raw: Path, serial: str, dropped: set[int], *, stamps: bool) -> None:
    folder = episode_of(raw) / "recordings/MP4"
    capture, frames = cv2.VideoCapture(str(folder / f"{serial}.mp4")), []
    while (frame := capture.read())[0]:
        frames.append(cv2.cvtColor(frame[1], cv2.COLOR_BGR2RGB))
    write_video(folder / f"{serial}.mp4", [f for i, f in enumerate(frames) if i not in dropped])
    path = folder / f"{serial}_timestamps.json"
    if stamps:
        path.write_text(json.dumps([x for i, x in enumerate(json.loads(path.read_text())) if i not in dropped]))
    else:
        path.unlink()


@pytest.mark.parametrize("stamps", [True, False])
def test_case_03_one_frame_less_at_the_end(raw, tmp_path, stamps):
    _without_frames(raw, EXT1, {11}, stamps=stamps)
    summary, recordings = ingest(raw, tmp_path / "out")
    assert summary.figures["frames"] == 11


def test_case_03_frames_missing_in_the_middle(raw, tmp_path):
    _without_frames(raw, EXT1, {4, 5}, stamps=True)
    depth = episode_of(raw) / "recordings/depth" / EXT1
    for frame in range(6, 12):  # depth pictures are numbered like the frames of the video
        (depth / f"{frame:06d}.png").replace(depth / f"{frame - 2:06d}.png")
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, f"{EXT1}.mp4", "2 of 12 rows (4, 5)")
    with recordings.open(recordings.names[0]) as recording:
        assert len(recording) == 10 and np.isclose(np.diff(recording.time_s).max(), 3 * 0.067)
        assert np.allclose(recording.world_from_tool[4], world_from_tool(flange_path(12))[6])


def test_depth_of_another_size_is_rescaled_and_said(raw, tmp_path):
    for path in sorted((episode_of(raw) / "recordings/depth" / EXT1).glob("*.png"))[2:]:
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_NEAREST))
    summary, _ = ingest(raw, tmp_path / "out")
    height, width = picture.shape
    sizes = f"{width // 2}x{height // 2} px, not the video's {width}x{height}"
    assert said(summary, f"depth/{EXT1}", sizes, "rescaled", "for 10 frames: 000002,")
    assert not said(summary, f"depth/{EXT2}", "rescaled")


def test_case_03_missing_frames_without_time_stamps_cost_the_camera(raw, tmp_path):
    _without_frames(raw, EXT1, {4, 5}, stamps=False)
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "cannot be matched", "10 frames")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT2]


def test_case_04_a_short_key_is_shifted_to_the_end(raw, tmp_path):
    key = "observation/robot_state/cartesian_position"
    with edit(raw) as file:
        values = file[key][3:]
        del file[key]
        file[key] = values
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, key, "9 rows instead of 12", "rows 3..11")
    with recordings.open(recordings.names[0]) as recording:
        assert len(recording) == 9 and np.allclose(recording.world_from_tool, world_from_tool(flange_path(12))[3:])


def test_case_05_stale_serials_are_ignored(raw, tmp_path):
    with edit(raw) as file:
        file["observation/camera_extrinsics/99999999_left"] = np.full((12, 6), 0.3)
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, "99999999", "another rig")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT1, EXT2]


def test_case_06_missing_extrinsics_and_no_metadata(raw, tmp_path):
    with edit(raw) as file:
        del file[f"observation/camera_extrinsics/{EXT1}_left"]
    next(episode_of(raw).glob("metadata_*.json")).unlink()
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "no pose", f"camera_extrinsics/{EXT1}_left")
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT2]


def test_case_06_missing_extrinsics_come_from_metadata_or_side_file(raw, tmp_path):
    with edit(raw) as file:
        del file[f"observation/camera_extrinsics/{EXT1}_left"]
    summary, recordings = ingest(raw, tmp_path / "a")
    assert said(summary, "ext1_cam_extrinsics")
    side = {"SIM+abcd1234+2023-08-06-22h-13m-04s": {EXT1: [0.7, -0.4, 0.5, -2.0, 0.1, 0.2], "source": "GT"}}
    (tmp_path / "cam2base.json").write_text(json.dumps(side))
    _, moved = ingest(raw, tmp_path / "b", extrinsics=tmp_path / "cam2base.json")
    with recordings.open(recordings.names[0]) as a, moved.open(moved.names[0]) as b:
        assert np.allclose(a.camera(EXT1, 0).world_from_cam, exterior_poses()[EXT1], atol=1e-6)
        assert np.allclose(b.camera(EXT1, 0).world_from_cam[:3, 3], [0.7, -0.4, 0.5])


def test_case_06_no_camera_type_falls_back_on_the_metadata(raw, tmp_path):
    with edit(raw) as file:
        del file["observation/camera_type"]
    summary, _ = ingest(raw, tmp_path / "a")
    assert said(summary, "camera_type", "metadata")
    next(episode_of(raw).glob("metadata_*.json")).unlink()
    with pytest.raises(PlopError, match="cameras of the episode are unknown"):
        ingest(raw, tmp_path / "b")


def test_case_07_wrong_extrinsics_show_in_the_table_and_between_episodes(raw, tmp_path):
    make_episode(raw, moment=datetime(2023, 8, 6, 22, 14, 4))
    path = raw / "SIM/success/2023-08-06/Sun_Aug__6_22:14:04_2023/trajectory.h5"
    with h5py.File(path, "r+") as file:
        file[f"observation/camera_extrinsics/{EXT1}_left"][:, 2] += 0.05
    summary, _ = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "sees the table", "+5")
    assert said(summary, EXT1, "moves by 50 mm", "60 s apart")


def test_case_08_pose_and_image_lag_is_interpolated_away(tmp_path):
    """The robot is read 30 ms before each picture: at capture time it has moved on."""
    make_episode(tmp_path / "raw", lag_ms=30)
    _, recordings = ingest(tmp_path / "raw", tmp_path / "out")
    poses = world_from_tool(flange_path(12))
    with recordings.open(recordings.names[0]) as recording:
        expected = poses[:-1, 2, 3] + np.diff(poses[:, 2, 3]) * 30 / 67
        assert np.allclose(recording.world_from_tool[:-1, 2, 3], expected)


def test_case_08_clocks_that_disagree_are_named(tmp_path):
    make_episode(tmp_path / "raw", lag_ms=400)
    summary, _ = ingest(tmp_path / "raw", tmp_path / "out")
    assert said(summary, "400 ms off the robot's clock")


def test_case_09_skipped_rows_and_idle_stretches(tmp_path):
    flange = flange_path(12)
    flange = np.concatenate([flange[:6], np.repeat(flange[5:6], 30, 0), flange[6:]])
    make_episode(tmp_path / "raw", flange6=flange, serials=(EXT1,))
    with edit(tmp_path / "raw") as file:
        file["observation/timestamp/skip_action"][:2] = True
    summary, _ = ingest(tmp_path / "raw", tmp_path / "out", rows__idle_s=0.3)
    assert summary.figures["frames"] == 12 - 2 + 4
    assert said(summary, "rows left out", "skip_action") and said(summary, "s between rows")
    summary, _ = ingest(tmp_path / "raw", tmp_path / "all", rows__idle_s=0, rows__keep_skipped=True)
    assert summary.figures["frames"] == 42


def test_case_10_a_file_without_action_is_read_as_far_as_it_goes(raw, tmp_path):
    with edit(raw) as file:
        del file["action"]
        file["observation/robot_state/cartesian_position"].resize(10, axis=0)
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, "trajectory.h5", "no `action`") and said(summary, "last 2 of 12 rows")
    with recordings.open(recordings.names[0]) as recording:
        assert np.allclose(recording.world_from_tool, world_from_tool(flange_path(12))[:10])


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_case_10_a_truncated_file_is_skipped(raw, tmp_path, share):
    path = episode_of(raw) / "trajectory.h5"
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(PlopError, match=r"trajectory cannot be read.*trajectory.h5"):
        ingest(raw, tmp_path / "out")


def test_case_11_a_stereo_file_without_its_suffix_gives_depth(tmp_path):
    make_episode(tmp_path / "raw", rows=5, scene=Scene(160, 120, 150.0), stereo=True, depth=False, serials=(EXT1, EXT2))
    folder = episode_of(tmp_path / "raw") / "recordings/MP4"
    for serial in (EXT1, EXT2):
        (folder / f"{serial}-stereo.mp4").rename(folder / f"{serial}.mp4")
    summary, recordings = ingest(tmp_path / "raw", tmp_path / "out")
    assert said(summary, f"{EXT1}.mp4", "both eyes") and summary.table[0]["depth"] == "stereo"
    with recordings.open(recordings.names[0]) as recording:
        view = recording.view(EXT1, 0)
        _, depth, truth = Scene(160, 120, 150.0).render(view.camera.world_from_cam, recording.world_from_tool[0])
        seen = (view.depth_m > 0) & (depth > 0)
        assert view.rgb.shape == (120, 160, 3) and np.median(np.abs(view.depth_m - depth)[seen]) < 0.01
        ours, theirs = view.object_mask, truth == MaskLabel.OBJECT
        assert (ours & theirs).sum() / (ours | theirs).sum() > 0.7  # depth from 160 pixels of lossy video


@pytest.mark.parametrize("rows", [1, 4])
def test_case_12_too_short_episodes_are_skipped(tmp_path, rows):
    make_episode(tmp_path / "raw", rows=rows, serials=(EXT1,))
    with pytest.raises(PlopError, match="too few frames"):
        ingest(tmp_path / "raw", tmp_path / "out")


def test_case_13_unknown_scene_and_building_do_not_matter(raw, tmp_path):
    with edit(raw) as file:
        assert file.attrs["scene_id"] == -1 and file.attrs["building"] == "N/A"
    summary, _ = ingest(raw, tmp_path / "out")
    assert summary.figures["episodes"] == 1


# What else goes wrong.


@pytest.mark.parametrize("pose", [[1, 2, 3, 4, 5, "x"], "none", [1, 2, 3], [0.1, 0.2, 0.3, 0, 0, float("nan")]])
@pytest.mark.parametrize("flat", [True, False])
def test_a_pose_of_a_side_file_that_is_none_names_file_and_camera(raw, tmp_path, pose, flat):
    entry = {EXT1: pose}
    (raw / "cam2base_extrinsics.json").write_text(
        json.dumps(entry if flat else {"SIM+abcd1234+2023-08-06-22h-13m-04s": entry})
    )
    summary, recordings = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "pose cannot be read", f"cam2base_extrinsics.json: {EXT1}", str(pose)[:9])
    with recordings.open(recordings.names[0]) as recording:
        assert recording.camera_names == [EXT2]


def test_poses_of_the_metadata_that_are_none_are_named(raw, tmp_path):
    with edit(raw) as file:
        del file[f"observation/camera_extrinsics/{EXT1}_left"]
    path = next(episode_of(raw).glob("metadata_*.json"))
    path.write_text(json.dumps({**json.loads(path.read_text()), "ext1_cam_extrinsics": ["a"] * 6}))
    summary, _ = ingest(raw, tmp_path / "out")
    assert said(summary, EXT1, "pose cannot be read", "ext1_cam_extrinsics")


WRONG = [
    ({"rows__stride": 0}, "1 to 10000"),
    ({"size": 2}, "8 to 8192 px"),
    ({"test_every": 0}, "2 to 1e6 episodes"),
    ({"rows__min_frames": 0}, "2 to 1e6 frames"),
    ({"rows__scan_frames": 0}, "1 to 10000 frames"),
    ({"cameras__baseline_m": -0.1}, "0 to 1 m"),
    ({"rows__idle_s": np.nan}, "0 to 1e6 s"),
    ({"cameras__match_width": 0}, "16 to 8192 px"),
    ({"cameras__farthest_m": 0.1}, "0.2 m or more"),
    ({"cameras__delay_ms": np.inf}, "-10000 to 10000 ms"),
    ({"touch_m": -1.0}, "0 to 1 m"),
    ({"mask__refine_px": -1}, "0 to 100 px"),
    ({"mask__hand_to_m": -1.0}, "-0.12 m or more"),
    ({"mask__min_area_px": -5}, "0 to 1e6 px"),
    ({"workspace_min": (np.nan, 0.0, 0.0)}, "-5 to 5 m"),
    ({"workspace_max": (850.0, 450.0, 500.0)}, "-5 to 5 m"),
    ({"workspace_min": (0.9, 0.0, 0.0)}, "min below max"),
    ({"outcome": "good"}, "any or success or failure"),
]


@pytest.mark.parametrize(("change", "expected"), WRONG)
def test_a_setting_out_of_range_is_refused_with_its_range(tmp_path, change, expected):
    with pytest.raises(PlopError) as caught:
        ingest(tmp_path / "raw", tmp_path / "out", **change)
    (key,) = (name.replace("__", ".") for name in change)
    assert key in str(caught.value.where) and expected in str(caught.value.expected)


def test_errors_name_files_as_seen_from_a_relative_raw_folder(raw, tmp_path, monkeypatch):
    notes = episode_of(raw) / "plop_episode.json"
    seen_from_raw = notes.relative_to(raw).as_posix()
    notes.write_text("{")
    monkeypatch.chdir(raw.parent)
    for folder in (Path(raw.name), raw, Path("..") / raw.parent.name / raw.name):
        with pytest.raises(PlopError) as caught:
            ingest(folder, tmp_path / "out")
        assert f"where: {seen_from_raw} |" in str(caught.value.found)
        assert str(raw.parent) not in str(caught.value.found)


def test_a_damaged_video_is_told_by_plop_alone(raw, tmp_path, capfd):
    for path in (episode_of(raw) / "recordings/MP4").glob("*.mp4"):
        path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(PlopError, match="bytes that do not decode"):
        ingest(raw, tmp_path / "out")
    assert capfd.readouterr().err == ""
