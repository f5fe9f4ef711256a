"""Data of other projects, and faults whose first cause must be named rather than their last symptom."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from plop.geometry.rigid import pose_from_euler_xyz
from tests.cases.case import Case, Done
from tests.support.droid_scene import EXT1, EXT2, make_episode


def lerobot(folder: Path) -> None:
    (folder / "raw/meta").mkdir(parents=True)
    (folder / "raw/meta/info.json").write_text(json.dumps({"codebase_version": "v3.0", "fps": 15}))
    (folder / "raw/data/chunk-000").mkdir(parents=True)
    (folder / "raw/data/chunk-000/file-000.parquet").write_bytes(b"PAR1")


def robomimic(folder: Path) -> None:
    (folder / "raw").mkdir()
    with h5py.File(folder / "raw/demo.hdf5", "w") as file:
        file["data/demo_0/actions"] = np.zeros((4, 7))


def phystwin(folder: Path) -> None:
    for name in ("color/0", "depth/0"):
        (folder / "raw" / name).mkdir(parents=True)
    (folder / "raw/calibrate.pkl").write_bytes(b"x")
    (folder / "raw/metadata.json").write_text(json.dumps({"WH": [848, 480], "fps": 30}))


def nerfstudio(folder: Path) -> None:
    (folder / "raw").mkdir()
    frames = [{"file_path": "images/0.png", "transform_matrix": np.eye(4).tolist()}]
    (folder / "raw/transforms.json").write_text(json.dumps({"fl_x": 500, "frames": frames}))


def obj_sequence(folder: Path) -> None:
    (folder / "raw").mkdir()
    for frame in range(3):
        trimesh.creation.box([0.1, 0.06, 0.05]).export(folder / f"raw/block_{frame:04d}.obj")


def blender_usd(folder: Path) -> None:
    (folder / "raw").mkdir()
    (folder / "raw/cut.usda").write_text('#usda 1.0\n(\n    upAxis = "Z"\n)\ndef Mesh "block"\n{\n}\n')


def euler_of_another_convention(folder: Path) -> None:
    """Intrinsic XYZ angles for extrinsic xyz; plop_episode.json names the tool only."""
    episode = make_episode(folder / "raw")
    notes = json.loads((episode / "plop_episode.json").read_text())
    (episode / "plop_episode.json").write_text(json.dumps({"tool": notes["tool"]}))
    with h5py.File(episode / "trajectory.h5", "r+") as file:
        for serial in (EXT1, EXT2):
            stored = file[f"observation/camera_extrinsics/{serial}_left"]
            turn = pose_from_euler_xyz(np.asarray(stored[0]))[:3, :3]
            stored[:, 3:] = Rotation.from_matrix(turn).as_euler("XYZ")


def bad_cameras(folder: Path) -> None:
    """A camera 60 mm off: too far for a registration, near enough for the block to be seen by both."""
    make_episode(folder / "raw")
    with h5py.File(next(folder.rglob("trajectory.h5")), "r+") as file:
        file[f"observation/camera_extrinsics/{EXT2}_left"][:, :3] += [0.06, 0.0, 0.03]


def nothing_kept_that_is_no_number(done: Done) -> None:
    for artifact in done.store.artifacts():
        json.dumps(artifact.manifest.summary, allow_nan=False)
        for path in artifact.path.rglob("*.json"):
            assert "NaN" not in path.read_text(encoding="utf-8"), path


def foreign(name: str, make: Callable[[Path], None], reader: str, words: tuple[str, ...], nearest: str) -> Case:
    return Case(
        name,
        "formats of other projects brought to plop",
        make,
        (f"ingest {reader} raw",),
        refused=(*words, "does not read yet", f"plop ingest {nearest}", "docs/how-to/droid-layout.md"),
    )


CASES = [
    foreign("lerobot-given-to-droid", lerobot, "droid", ("LeRobot", "v3.0"), "droid"),
    foreign("robomimic-given-to-droid", robomimic, "droid", ("robomimic", "demo.hdf5"), "droid"),
    foreign("phystwin-given-to-droid", phystwin, "droid", ("PhysTwin", "tool"), "droid"),
    foreign("nerfstudio-given-to-droid", nerfstudio, "droid", ("nerfstudio", "depth"), "droid"),
    foreign("obj-sequence-given-to-mesh", obj_sequence, "mesh", ("block_0000.obj", "write_mesh_sequence"), "mesh"),
    foreign("blender-usd-given-to-disect", blender_usd, "disect", ("USD", "cut.usda", "upAxis"), "mesh"),
    Case(
        "euler-angles-blame-the-cameras",
        "droid-dataset/droid#10",
        euler_of_another_convention,
        ("ingest droid raw",),
        refused=("Poses of cameras", "Euler"),
        never=("fix: Check flange_from_tool",),
    ),
    Case(
        "no-nan-in-messages",
        "ARISE-Initiative/robomimic#203",
        bad_cameras,
        ("ingest droid raw", "calibrate --no-correct", "fuse --min-points 50"),
        warned=("extrinsics", "bad"),
        never=("nan",),
        right=nothing_kept_that_is_no_number,
    ),
]
