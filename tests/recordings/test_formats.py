"""Which format a folder is in, and what is said of one that the command does not read."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.readers.formats import FORMATS, READ, recognise
from plop.recordings.readers.raw_folder import ask_format, check_raw_folder
from plop_cli.app import main
from stages import PIPELINE


def put(path: Path, content: str | bytes = b"x") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def hdf5(path: Path, *keys: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for key in keys:
            file[key] = np.zeros(2)


def npz(path: Path, *keys: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{key: np.zeros(2) for key in keys})


MESH = ("times", "vertices", "faces", "world_from_tool", "tool_vertices", "tool_faces")
MAKERS = {
    "DROID raw episodes": lambda f: put(f / "LAB/success/2023-08-06/Sun_Aug__6/trajectory.h5"),
    "DiSECt recordings": lambda f: npz(f / "a.npz", "points_rest", "knife_position", "tets"),
    "mesh sequences": lambda f: npz(f / "a.npz", *MESH),
    "LeRobot data set": lambda f: put(f / "meta/info.json", json.dumps({"codebase_version": "v2.1"})),
    "RLDS / TFDS data set": lambda f: put(f / "1.0.0/droid-train.tfrecord-00000-of-02048"),
    "robomimic HDF5 file": lambda f: hdf5(f / "low_dim.hdf5", "data/demo_1/actions"),
    "ALOHA / ACT HDF5 file": lambda f: hdf5(f / "episode_0.hdf5", "observations/qpos"),
    "Zarr replay buffer (UMI, diffusion policy)": lambda f: put(f / "replay_buffer.zarr/.zgroup"),
    "PhysTwin capture": lambda f: [put(f / "calibrate.pkl"), put(f / "color/0/0.png")],
    "nerfstudio capture": lambda f: put(f / "scene/transforms.json", json.dumps({"frames": []})),
    "COLMAP model": lambda f: [put(f / "sparse/0/cameras.bin"), put(f / "sparse/0/images.bin")],
    "ROS bag or MCAP log": lambda f: put(f / "run_0.mcap"),
    "sequence of surfaces": lambda f: [put(f / f"blob{i}.PLY") for i in range(3)],
    "USD scene": lambda f: put(f / "cut.usdc"),
}


def test_every_format_has_a_maker_here_and_every_reader_is_a_command():
    assert list(MAKERS) == [each.name for each in FORMATS]
    assert {f"ingest {each.reader}" for each in READ} == {r.command for r in PIPELINE if r.name == "ingest"}
    assert all(each.nearest in {r.reader for r in READ} and each.advice for each in FORMATS if not each.reader)


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("below", ["", "data", "a/b"])
def test_a_format_is_recognised_where_it_lies_and_one_or_two_folders_up(tmp_path, name, below):
    MAKERS[name](tmp_path / below)
    put(tmp_path / "README.md")
    found = recognise(tmp_path)
    assert found is not None and found.format.name == name


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("reader", ["droid", "disect", "mesh"])
def test_a_reader_takes_its_own_and_names_any_other(tmp_path, name, reader):
    MAKERS[name](tmp_path / "raw")
    form = next(each for each in FORMATS if each.name == name)
    if form.reader == reader:
        check_raw_folder(tmp_path / "raw", reader)
        return
    with pytest.raises(PlopError) as caught:
        check_raw_folder(tmp_path / "raw", reader)
    told = caught.value
    assert name in told.problem and told.fix
    assert (
        f"plop ingest {form.reader} {tmp_path / 'raw'}" if form.reader else "docs/how-to/droid-layout.md"
    ) in told.fix


@pytest.mark.parametrize(
    "make",
    [
        lambda f: put(f / "broken.npz"),
        lambda f: [put(f / "broken.npz"), put(f / "tool_1.obj"), put(f / "tool_2.obj")],
        lambda f: put(f / "notes.txt"),
        lambda f: npz(f / "a.npz", "times", "vertices"),
    ],
)
def test_what_is_damaged_or_unknown_is_left_to_the_reader(tmp_path, make):
    make(tmp_path)
    check_raw_folder(tmp_path, "mesh")


def test_a_large_data_set_is_recognised_at_a_glance(tmp_path):
    for lab in range(3):
        for day in range(150):
            (tmp_path / f"LAB{lab}/success/day{day:03d}/time").mkdir(parents=True)
    put(tmp_path / "knife_1.stl")
    put(tmp_path / "knife_2.stl")
    for lab in range(3):
        for day in range(150):
            put(tmp_path / f"LAB{lab}/success/day{day:03d}/time/trajectory.h5")
    check_raw_folder(tmp_path, "droid")


def test_no_folder_says_what_is_nearest(tmp_path):
    npz(tmp_path / "recordings/blocks/a.npz", *MESH)
    for wrong, near in (
        ("recordings/block", "recordings/blocks"),
        ("recording/blocks", "recordings"),
        ("Recordings/Blocks", "recordings"),
    ):
        error = ask_format(tmp_path / wrong)
        assert f"Did you mean {tmp_path / near}" in str(error.fix)
    assert "has no xyz" in str(ask_format(tmp_path / "xyz").fix)


def test_empty_archive_file_and_a_level_too_high(tmp_path):
    (tmp_path / "empty").mkdir()
    put(tmp_path / "data.zip")
    npz(tmp_path / "sims/blocks/a.npz", *MESH)
    assert "empty" in ask_format(tmp_path / "empty").problem
    assert "Unpack" in str(ask_format(tmp_path / "data.zip").fix)
    command = f"plop ingest mesh {tmp_path / 'sims/blocks'}"
    assert ask_format(tmp_path / "sims/blocks/a.npz", ["--test", "x*"]).fix == f"Type: {command} --test 'x*'"
    with pytest.raises(PlopError) as caught:
        check_raw_folder(tmp_path / "sims", "mesh")
    assert "another folder" in caught.value.problem and caught.value.fix == f"Type: {command}"


def test_ingest_without_a_format_guesses_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    npz(tmp_path / "my sims/a.npz", *MESH)
    assert main(["ingest", "my sims", "--cameras.size", "64"]) == 1
    said = capsys.readouterr().err
    assert "plop ingest mesh 'my sims' --cameras.size 64" in said
    assert all(f"plop ingest {name} PATH" in said for name in ("droid", "disect", "mesh"))
    assert main(["ingest", "./nowhere"]) == 1 and "no such folder" in capsys.readouterr().err
    assert main(["ingest", "drod", "x"]) == 2 and "droid" in capsys.readouterr().err
    assert main(["ingest", "disect", "my sims"]) == 1
    assert "plop ingest mesh 'my sims'" in capsys.readouterr().err
