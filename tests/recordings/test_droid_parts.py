"""Parts of the DROID reader: names, clocks, intrinsics, stereo depth, notes."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from plop.causes import Cause
from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.droid.align import active_rows, frames_of_rows, poses_at
from plop.recordings.readers.droid.camera import _baseline
from plop.recordings.readers.droid.depth import ExportedDepth, StereoDepth
from plop.recordings.readers.droid.intrinsics import find_intrinsics, matrix_from_side
from plop.recordings.readers.droid.layout import find_episodes, inside, stamp_of
from plop.recordings.readers.droid.notes import read_notes
from plop.recordings.readers.droid.pose import check_pose
from plop.recordings.readers.droid.tool import tool_mesh
from plop.recordings.readers.droid.video import find_video, open_video
from plop.recordings.readers.droid.writer import write_video
from plop.recordings.readers.side_pictures import find_side_pictures
from tests.support.droid_scene import EXT1, Scene, exterior_poses, make_episode, right_eye


@pytest.mark.parametrize("name", ["Sun_Aug__6_22:13:04_2023", "Sun_Aug__6_22_13_04_2023"])
def test_folder_names_with_double_underscore_and_either_separator(name):
    assert stamp_of(name) == "2023-08-06-22h-13m-04s"


def test_other_folder_names_have_no_stamp():
    assert stamp_of("episode_3") == "" and stamp_of("Sun_Feb_31_22:13:04_2023") == ""


def test_episodes_are_found_at_every_level(tmp_path):
    for folder in ("A/success/2023-08-06/Sun_Aug__6_22:13:04_2023", "B/failure/2023-08-16/Wed_Aug_16_02_13_04_2023"):
        (tmp_path / folder / "recordings").mkdir(parents=True)
    found = find_episodes(tmp_path)
    assert [(e.name, e.lab, e.outcome) for e in found] == [
        ("A_2023-08-06-22h-13m-04s", "A", "success"),
        ("B_2023-08-16-02h-13m-04s", "B", "failure"),
    ]
    assert [e.name for e in find_episodes(found[1].folder)] == ["B_2023-08-16-02h-13m-04s"]


def test_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(PlopError, match="No DROID episode"):
        find_episodes(tmp_path)


@pytest.mark.parametrize("path", ["/etc/hostname", "../outside", "a/../../outside"])
def test_paths_that_leave_the_raw_folder_are_refused(tmp_path, path):
    with pytest.raises(PlopError, match="outside the raw folder"):
        inside(tmp_path, path, where="notes: scan_episode")


def test_a_link_that_leaves_the_raw_folder_is_refused(tmp_path):
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "link").symlink_to(tmp_path)
    with pytest.raises(PlopError, match="outside the raw folder"):
        inside(tmp_path / "raw", "link/secret", where="x")


def test_euler_convention_against_known_real_poses():
    """The four cameras of DROID's calibration_info.json: left and right eye are a ZED's baseline apart."""
    eyes = [  # baseline as built, left and right [x, y, z, a, b, c]
        (
            0.120,
            [0.11133259, 0.82074817, 0.04550905, -1.64633975, -0.17857016, -2.93766368],
            [-0.00941784, 0.79726687, 0.06931512, -1.64730253, -0.18917295, -2.94221890],
        ),
        (
            0.063,
            [-0.07528311, 0.02872137, 0.02331657, -0.32557736, 0.00624743, -1.56287453],
            [-0.06961441, -0.03539660, 0.02041079, -0.31886274, 0.00782202, -1.55214306],
        ),
        (
            0.120,
            [0.41548840, 0.47754709, 0.41143223, -2.21604102, -0.02257695, -2.96372386],
            [0.29402237, 0.45672118, 0.41110094, -2.20799482, -0.01940120, -2.95977621],
        ),
        (
            0.120,
            [0.25955495, -0.50010183, 0.43688190, -2.27734563, 0.33618977, -0.53690070],
            [0.35203881, -0.55772972, 0.40182455, -2.27980636, 0.34639742, -0.54752158],
        ),
    ]
    off = []
    for built, *pair in eyes:
        left, right = pose_from_euler_xyz(np.array(pair))
        step = left[:3, :3].T @ (right[:3, 3] - left[:3, 3])
        assert step[0] / np.linalg.norm(step) > 0.97  # the right eye lies along the left camera's x axis
        off.append(abs(np.linalg.norm(step) / built - 1))
    assert min(off) > 0.02 and max(off) < 0.05  # so depth of real extrinsics is 2 to 5 % off


def test_extrinsics_that_are_no_zed_baseline_warn_and_millimetres_fail():
    assert _baseline("c", (np.zeros(6), np.eye(6)[0] * 0.1145), 530, 0)[1]
    assert not _baseline("c", (np.zeros(6), np.eye(6)[0] * 0.1201), 530, 0)[1]
    with pytest.raises(PlopError, match="stereo baseline"):
        _baseline("c", (np.zeros(6), np.eye(6)[0] * 120), 530, 0)
    baseline, warnings = _baseline("c", None, 733, 0)
    assert baseline == 0.063 and "missing" in warnings[0]


def test_rows_follow_time_stamps(tmp_path):
    stamps = tmp_path / "1_timestamps.json"
    stamps.write_text(json.dumps([1000, 1067, 1201, 1268]))
    index, warnings = frames_of_rows(np.array([1000, 1067, 1134, 1201, 1268.0]), 4, stamps, 0, tmp_path / "1.mp4")
    assert index.tolist() == [0, 1, -1, 2, 3]
    assert "1 of 5 rows (2)" in warnings[0]


@pytest.mark.parametrize("frames, last", [(5, 4), (4, -1)])
def test_without_time_stamps_row_is_frame(tmp_path, frames, last):
    index, warnings = frames_of_rows(np.full(5, 7.0), frames, tmp_path / "1_timestamps.json", 0, tmp_path / "1.mp4")
    assert index.tolist() == [0, 1, 2, 3, last] and "missing" in warnings[0]


def test_without_time_stamps_other_counts_fail(tmp_path):
    with pytest.raises(PlopError, match="cannot be matched"):
        frames_of_rows(np.full(5, 7.0), 3, tmp_path / "1_timestamps.json", 0, tmp_path / "1.mp4")


def test_time_stamps_of_another_episode_fail(tmp_path):
    (tmp_path / "1_timestamps.json").write_text("[100, 167, 234]")
    with pytest.raises(PlopError, match="No time stamp"):
        frames_of_rows(np.array([1000, 1067, 1134.0]), 3, tmp_path / "1_timestamps.json", 0, tmp_path / "1.mp4")


def test_poses_between_rows_are_interpolated():
    poses = np.array([[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0.2]], float)
    middle = poses_at(poses, np.array([1000, 1100]), np.array([1050.0, 900.0]))
    assert np.allclose(middle[0], pose_from_euler_xyz(np.array([0.05, 0, 0, 0, 0, 0.1])))
    assert np.allclose(middle[1], np.eye(4))


def test_idle_stretches_are_cut():
    flange = np.zeros((40, 6))
    flange[:10, 0] = np.linspace(0, 0.1, 10)
    flange[10:30, 0] = 0.1
    flange[30:, 0] = np.linspace(0.12, 0.3, 10)
    kept = active_rows(flange, np.arange(40) / 10, np.arange(40), idle_s=0.5, idle_m=0.002)
    assert set(range(10)) <= set(kept) and set(range(30, 40)) <= set(kept)
    assert len(kept) == 25
    assert len(active_rows(flange, np.arange(40) / 10, np.arange(40), idle_s=0, idle_m=0.002)) == 40


@pytest.mark.parametrize(
    "entry",
    [
        {"cameraMatrix": [530.0, 640.0, 531.0, 360.0]},
        [530.0, 640.0, 531.0, 360.0],
        [530.0, 531.0, 640.0, 360.0],
        [[530.0, 0, 640.0], [0, 531.0, 360.0], [0, 0, 1.0]],
    ],
)
def test_every_order_of_intrinsics_gives_the_same_matrix(entry):
    matrix, _ = matrix_from_side(entry, "intrinsics.json")
    assert np.allclose(matrix, [[530, 0, 640], [0, 531, 360], [0, 0, 1]])


def test_intrinsics_priority_and_scale(tmp_path):
    make_folder = tmp_path / "L/success/d/Sun_Aug__6_22:13:04_2023/recordings"
    make_folder.mkdir(parents=True)
    episode = find_episodes(tmp_path)[0]
    side = {"L+user+2023-08-06-22h-13m-04s": {"7": {"cameraMatrix": [530.0, 640.0, 530.0, 360.0]}}}
    options = {"side_name": "intrinsics.json", "focal_px": 500.0}
    stored = {"7_left": np.array([[700.0, 0, 640], [0, 700, 360], [0, 0, 1]])}
    size = (1280, 720)
    assert find_intrinsics(episode, "7", size, stored=stored, side=side, **options)[0][0, 0] == 700
    matrix, _ = find_intrinsics(episode, "7", size, stored={}, side=side, **options)
    assert matrix[0, 0] == 530 and matrix[0, 2] == 640.5  # pixel centres at half-integers
    half, warnings = find_intrinsics(episode, "7", (640, 360), stored={}, side=side, **options)
    assert half[0, 0] == 265 and "scaled" in warnings[0]
    guess, warnings = find_intrinsics(episode, "8", size, stored={}, side=side, **options)
    assert guess[0, 0] == 500 and "assumed" in warnings[0]
    with pytest.raises(PlopError, match="no intrinsics"):
        find_intrinsics(episode, "8", size, stored={}, side={}, side_name="", focal_px=0)


def test_stereo_depth_of_a_plane_with_known_disparity():
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 255, (120, 400, 3), np.uint8), (0, 0), 1.2)
    shift, focal, baseline = 24, 300.0, 0.12
    left, right = texture[:, 40:300], texture[:, 40 + shift : 300 + shift]
    depth = StereoDepth(focal, baseline, 260, match_width=260).depth_m(0, left, right)
    seen = depth[:, shift + 8 : -8]
    assert (seen > 0).mean() > 0.95
    assert np.abs(seen[seen > 0] - focal * baseline / shift).max() < 0.02


def test_stereo_depth_of_the_scene():
    scene = Scene(320, 240, 300.0)
    pose = exterior_poses()[EXT1]
    left, truth, _ = scene.render(pose, None)
    right, _, _ = scene.render(right_eye(pose, 0.12), None)
    depth = StereoDepth(300.0, 0.12, 320).depth_m(0, left, right)
    seen = (depth > 0) & (truth > 0) & (truth < 2)
    assert seen.mean() > 0.7
    assert np.median(np.abs(depth - truth)[seen]) < 0.004


def test_exported_depth_checks_its_pictures(tmp_path):
    left = np.zeros((48, 64, 3), np.uint8)
    depth = np.full((48, 64), 500, np.uint16)
    depth[0, 0], depth[0, 1] = 0, 65535
    cv2.imwrite(str(tmp_path / "000000.png"), depth)
    cv2.imwrite(str(tmp_path / "000002.png"), depth.astype(np.uint8))
    source = ExportedDepth(find_side_pictures(tmp_path, 10, what="depth images", cause=Cause.DEPTH))
    got = source.depth_m(0, left, None)
    assert got[0, 0] == 0 and got[0, 1] == 0 and got[5, 5] == np.float32(0.5)
    assert not source.depth_m(1, left, None).any()
    assert any("000001" in text for text in source.warnings()) and any("65535" in text for text in source.warnings())
    with pytest.raises(PlopError, match="wrong format"):
        source.depth_m(2, left, None)


def test_the_shape_of_the_picture_decides_what_is_stereo(tmp_path):
    (tmp_path / "MP4").mkdir()
    write_video(tmp_path / "MP4" / "7.mp4", [np.full((48, 128, 3), 90, np.uint8)] * 3)
    video, warnings = find_video(tmp_path, "7", stereo=True)
    assert video.stereo and (video.width, video.height, video.frames) == (64, 48, 3)
    assert "both eyes" in warnings[0]


def test_a_truncated_video_is_an_error(tmp_path):
    write_video(tmp_path / "7.mp4", [np.full((48, 64, 3), 90, np.uint8)] * 3)
    whole = (tmp_path / "7.mp4").read_bytes()
    for keep in (0, len(whole) // 3):
        (tmp_path / "7.mp4").write_bytes(whole[:keep])
        with pytest.raises(PlopError, match="cannot be opened"):
            open_video(tmp_path / "7.mp4")


def test_a_frame_past_the_end_is_named(tmp_path):
    write_video(tmp_path / "7.mp4", [np.full((48, 64, 3), 90, np.uint8)] * 3)
    with pytest.raises(PlopError, match="frame 3"):
        list(open_video(tmp_path / "7.mp4").read(np.array([1, 3])))


@pytest.mark.parametrize("pose, words", [([500, 0, 300, 0, 0, 0], "metres"), ([0.5, 0, 0.3, 90, 0, 0], "radians")])
def test_millimetres_and_degrees_are_refused(pose, words):
    with pytest.raises(PlopError, match=words):
        check_pose(np.array(pose, float), where="x", what="camera")


@pytest.mark.parametrize(
    "notes, words",
    [
        ({"workspace": {"min": [350, -150, 0], "max": [650, 150, 300]}}, "millimetres"),
        ({"workspace": {"min": [1, 0, 0], "max": [0, 1, 1]}}, "min below max"),
        ({"table_z": 20.0}, "millimetres"),
        ({"table": 0.0}, "unknown key"),
        ({"scan": [5, 2]}, "first <= last"),
        ({"scan": [0.5, 2]}, "first row"),
        ({"scan_episode": "../../../../../../etc"}, "outside the raw folder"),
        ({"tool": {"mesh": "nothing.stl"}}, "no file"),
        ({"tool": {"mesh": "/etc/hostname"}}, "outside the raw folder"),
        ({"tool": {"flange_from_tool": [0, 0, 1]}}, "6 finite numbers"),
    ],
)
def test_notes_with_mistakes_are_refused(tmp_path, notes, words):
    folder = tmp_path / "L/success/d/t"
    (folder / "recordings").mkdir(parents=True)
    (folder / "plop_episode.json").write_text(json.dumps(notes))
    with pytest.raises(PlopError, match=words):
        read_notes(find_episodes(tmp_path)[0])


def test_notes_of_a_folder_above_serve_all_episodes(tmp_path):
    (tmp_path / "L/success/d/t/recordings").mkdir(parents=True)
    (tmp_path / "plop_episode.json").write_text('{"table_z": 0.03}')
    assert read_notes(find_episodes(tmp_path)[0]).table_z_m == 0.03


def test_a_tool_in_millimetres_is_refused(tmp_path):
    import trimesh

    trimesh.creation.box((120, 4, 50)).export(tmp_path / "knife.stl")
    with pytest.raises(PlopError, match="millimetres"):
        tool_mesh(tmp_path / "knife.stl", "e")
    (tmp_path / "bad.stl").write_text("no mesh")
    with pytest.raises(PlopError, match="mesh is not"):
        tool_mesh(tmp_path / "bad.stl", "e")


def test_metadata_that_is_broken_costs_a_warning(tmp_path):
    folder: Path = make_episode(tmp_path, rows=2, moment=datetime(2023, 8, 16, 1, 2, 3))
    next(folder.glob("metadata_*.json")).write_text("{")
    episode = find_episodes(tmp_path)[0]
    assert episode.metadata == {} and "not readable" in episode.warnings[0]
    assert episode.matches_uuid("SIM+abcd1234+2023-08-16-01h-02m-03s")
