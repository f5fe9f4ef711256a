"""Nothing of a test episode but its first frame enters the fit; the tool may be coloured by training episodes."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial import cKDTree

from plop.gaussians.splat_ply import read_splat
from plop.geometry.rigid import transform_points
from plop.pipeline.stage import Input, Output
from plop.recordings.recording import MaskLabel, Mesh, Recording
from plop.recordings.set import RecordingSet
from plop.render.sh import C0
from plop.sensors.silhouette import outline
from stages.fit_init.stage import STAGE, FitInitConfig
from stages.fit_init.tool_splats import sample_mesh
from tests.support.ellipsoid_scene import TOOL, ring, write_recording

QUICK = FitInitConfig(count=60, steps=2, tool_count=40, virtual_views=0, jobs=1)
SIZE = 48
RED, GREEN, BLUE = (200, 20, 20), (20, 200, 20), (20, 20, 200)
TOOL_TIMES_3 = Mesh(3 * TOOL.vertices, TOOL.faces)


def show_tool(path: Path, colours: list[tuple[int, int, int] | None]) -> None:
    """Put the tool above the object and paint it into every frame; None leaves a frame without it, and black."""
    with h5py.File(path, "r+") as file:
        pose = file["tool/world_from_tool"][0]
        pose[:3, 3] = 0, 0, 0.09
        file["tool/world_from_tool"][...] = pose
        file["tool/mesh/vertices"][...] = TOOL_TIMES_3.vertices
    points, _ = sample_mesh(TOOL_TIMES_3, 2000, 0)
    with Recording(path) as recording:
        cameras = {name: recording.camera(name, 0) for name in recording.camera_names}
    with h5py.File(path, "r+") as file:
        for name, camera in cameras.items():
            data = file[f"cameras/{name}"]
            pixels, depth = camera.project(transform_points(pose, points))
            rows, columns = np.nonzero(outline(TOOL_TIMES_3, pose, camera))
            near = cKDTree(pixels).query(np.stack([columns, rows], 1) + 0.5, k=8)[1]
            for frame, colour in enumerate(colours):
                if colour is None:
                    data["rgb"][frame] = 0
                    continue
                rgb, mask, measured = (data[key][frame] for key in ("rgb", "mask", "depth_m"))
                rgb[rows, columns], mask[rows, columns] = colour, MaskLabel.TOOL
                measured[rows, columns] = depth[near].min(1)
                data["rgb"][frame], data["mask"][frame], data["depth_m"][frame] = rgb, mask, measured


def fitted(folder: Path, train: list, test: list) -> dict[str, dict[str, bytes]]:
    """Write a training and a test episode with these tool colours, fit them; gives each episode's files."""
    for name, colours in (("train", train), ("test", test)):
        write_recording(folder / "set" / "episodes" / f"{name}.h5", ring(4, SIZE), frames=len(colours))
        show_tool(folder / "set" / "episodes" / f"{name}.h5", colours)
    RecordingSet(folder / "set", "scene", ["train"], ["test"]).save()
    (folder / "out").mkdir()
    STAGE.run({"recordings": Input(folder / "set")}, QUICK, Output(folder / "out"))
    return {
        name: {file.name: file.read_bytes() for file in (folder / "out" / name).iterdir()} for name in ("train", "test")
    }


def colour_of(folder: Path, name: str) -> np.ndarray:
    return (255 * (read_splat(folder / "out" / name / "tool.ply").sh[:, 0] * C0 + 0.5)).mean(0).numpy()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    return folder, fitted(folder, [RED, RED, RED], [GREEN, GREEN, GREEN])


@pytest.mark.parametrize("later", [[GREEN, None, None], [GREEN, BLUE, BLUE]])
def test_later_frames_of_a_test_episode_change_nothing(plain, tmp_path, later):
    assert fitted(tmp_path, [RED, RED, RED], later) == plain[1]


def test_its_first_frame_and_a_training_episode_colour_the_tool(plain, tmp_path):
    assert colour_of(plain[0], "train") == pytest.approx(RED, abs=12)
    both = colour_of(plain[0], "test")
    assert both[0] > 60 and both[1] > 60 and both[2] < 40
    changed = fitted(tmp_path, [RED, BLUE, BLUE], [GREEN, GREEN, GREEN])
    assert changed["test"]["object.ply"] == plain[1]["test"]["object.ply"]
    assert changed["test"]["tool.ply"] != plain[1]["test"]["tool.ply"]


def test_a_tool_that_only_training_episodes_show_is_not_grey(tmp_path):
    fitted(tmp_path, [RED, RED, RED], [None, BLUE, BLUE])
    assert colour_of(tmp_path, "test") == pytest.approx(RED, abs=12)
