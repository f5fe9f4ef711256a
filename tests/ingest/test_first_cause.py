"""A DROID episode that is skipped says first what went wrong first, and keeps what was noticed on the way."""

from __future__ import annotations

import json
from datetime import datetime

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.rigid import pose_from_euler_xyz
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from stages.ingest.droid import INGEST_DROID, DroidConfig
from stages.ingest.droid_checks import check_views
from stages.ingest.masks import Picture
from tests.ingest.droid_runs import edit
from tests.support.droid_scene import (
    EXT1,
    EXT2,
    FLANGE_FROM_TOOL,
    TABLE_Z,
    WORKSPACE,
    Scene,
    exterior_poses,
    make_episode,
)


def refused(raw, out) -> tuple[PlopError, dict]:
    """The refusal, and the report of the first episode."""
    out.mkdir()
    with pytest.raises(PlopError) as caught:
        INGEST_DROID.run({"raw": Input(raw)}, DroidConfig(), Output(out))
    return caught.value, json.loads(next((out / "reports").glob("*.json")).read_text())


def test_cameras_that_disagree_stand_before_a_tool_that_never_touches(tmp_path):
    tool = {"mesh": "../../../../knife.stl", "flange_from_tool": [0.3, *FLANGE_FROM_TOOL[1:]]}
    make_episode(tmp_path / "raw", notes={"tool": tool})
    with edit(tmp_path / "raw") as file:
        file[f"observation/camera_extrinsics/{EXT2}_left"][:, 1] += 0.09
    error, report = refused(tmp_path / "raw", tmp_path / "out")
    found = str(error.found)
    assert 0 < found.index(f"cameras {EXT1} and {EXT2}") < found.index("The tool never touches")
    assert "Check the cameras' extrinsics" in str(error.fix) and "flange_from_tool" in str(error.fix)
    assert any("apart" in text for text in report["warnings"])


def test_a_tool_that_never_touches_is_blamed_where_the_cameras_agree(tmp_path):
    tool = {"mesh": "../../../../knife.stl", "flange_from_tool": [0.3, *FLANGE_FROM_TOOL[1:]]}
    make_episode(tmp_path / "raw", notes={"tool": tool})
    error, _ = refused(tmp_path / "raw", tmp_path / "out")
    assert ": The tool never touches the object." in str(error.found) and "extrinsics" not in str(error.fix)


def test_euler_angles_of_another_convention_blame_the_cameras(tmp_path):
    folder = make_episode(tmp_path / "raw")
    notes = json.loads((folder / "plop_episode.json").read_text())
    (folder / "plop_episode.json").write_text(json.dumps({"tool": notes["tool"]}))
    with edit(tmp_path / "raw") as file:
        for serial in (EXT1, EXT2):
            stored = file[f"observation/camera_extrinsics/{serial}_left"]
            turn = pose_from_euler_xyz(np.asarray(stored[0]))[:3, :3]
            stored[:, 3:] = Rotation.from_matrix(turn).as_euler("XYZ")
    error, _ = refused(tmp_path / "raw", tmp_path / "out")
    assert "Poses of cameras use another convention" in str(error.found) and "XYZ Euler" in str(error.found)
    assert str(error.fix).startswith("Convert the poses")


def test_what_the_reader_noticed_is_told_with_its_refusal(tmp_path):
    make_episode(tmp_path / "raw")
    with edit(tmp_path / "raw") as file:
        poses = file["observation/camera_extrinsics"]
        for key in list(poses):
            poses.move(key, f"other_{key}")
    next((tmp_path / "raw").rglob("metadata_*.json")).unlink()  # it gives the poses, too
    error, report = refused(tmp_path / "raw", tmp_path / "out")
    assert "to another rig" in str(error.found)
    assert any("to another rig" in text for text in report["warnings"])
    assert str(tmp_path) not in json.dumps(report)


def test_a_good_episode_beside_a_bad_one_keeps_the_reason_in_the_set(tmp_path):
    make_episode(tmp_path / "raw")
    tool = {"mesh": "../../../../knife.stl", "flange_from_tool": [0.3, *FLANGE_FROM_TOOL[1:]]}
    bad = make_episode(tmp_path / "raw", notes={"tool": tool}, moment=datetime(2023, 8, 6, 23, 1, 1))
    (bad / "recordings/MP4" / f"{EXT1}.mp4").unlink()
    (tmp_path / "out").mkdir()
    summary = INGEST_DROID.run({"raw": Input(tmp_path / "raw")}, DroidConfig(), Output(tmp_path / "out"))
    (reason,) = RecordingSet.load(tmp_path / "out").skipped.values()
    assert f"camera {EXT1} is left out" in reason and "never touches" in reason
    assert any(reason in text for text in summary.warnings)


@pytest.mark.parametrize(
    ("turn_deg", "noise_m", "warned"),
    [(0, 0.0, False), (0, 0.01, False), (2, 0.005, False), (60, 0.0, True), (60, 0.01, True), (-45, 0.005, True)],
)
def test_cameras_whose_tables_cross_are_told_and_noise_is_not(turn_deg, noise_m, warned):
    scene, poses, drawn = Scene(), exterior_poses(), np.random.default_rng(0)
    pictures = {}
    for serial, pose in poses.items():
        rgb, depth, mask = scene.render(pose, None)
        stored = pose.copy()
        if serial == EXT2:
            stored[:3, :3] = Rotation.from_euler("y", turn_deg, degrees=True).as_matrix() @ stored[:3, :3]
        noisy = np.where(depth > 0, depth + noise_m * drawn.normal(size=depth.shape), 0).astype(np.float32)
        pictures[serial] = Picture(scene.camera(stored), rgb, noisy, np.eye(4), None, "e", 0)
    box = np.array([WORKSPACE["min"], WORKSPACE["max"]])
    told = check_views(pictures, {}, box, TABLE_Z, "e")
    assert any("contradict each other" in text for text in told) == warned
