"""Raw episodes of robots as people really have them: clocks, numbering, axes, units, names, encodings."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import cv2
import h5py
import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from plop.geometry.rigid import pose_from_euler_xyz
from plop.recordings.readers.droid.writer import STEP_MS, write_video
from tests.cases.case import Case, Done
from tests.support.droid_scene import BLOCK, EXT1, EXT2, Scene, exterior_poses, make_episode, pose6, right_eye

ROWS = 10
NAME = "SIM_2023-08-06-22h-13m-04s"
INGEST = ("ingest droid raw --environment cut",)
MASKS = (INGEST[0] + " --masks masks",)


@cache
def _pristine() -> Path:
    root = Path(mkdtemp(prefix="plop-droid-")) / "raw"
    make_episode(root, rows=ROWS, serials=(EXT1, EXT2))
    return root


def _made(change: Callable[[Path, Path], None]) -> Callable[[Path], None]:
    """Copy a good episode to <workspace>/raw, then `change(workspace, episode)`."""

    def make(folder: Path) -> None:
        shutil.copytree(_pristine(), folder / "raw")
        change(folder, next((folder / "raw").glob("*/*/*/*/trajectory.h5")).parent)

    return make


def _clocks(trajectory: Callable, stamps: Callable) -> Callable[[Path], None]:
    """Change every stamp of the trajectory, and of the side files: whole ms since 1970 -> what is stored."""

    def change(_: Path, episode: Path) -> None:
        with h5py.File(episode / "trajectory.h5", "r+") as file:
            group = file["observation/timestamp"]
            keys: list[str] = []
            group.visititems(lambda key, node: keys.append(key) if isinstance(node, h5py.Dataset) else None)
            for key in keys:
                if key != "skip_action":
                    values = trajectory(group[key][:])
                    del group[key]
                    group[key] = values
        for path in episode.glob("recordings/MP4/*_timestamps.json"):
            values = stamps(np.array(json.loads(path.read_text())))
            path.write_text(json.dumps([x.item() for x in values]))

    return _made(change)


def _rename(folder_of: Callable[[Path, Path], list[Path]], name: Callable[[int], str]) -> Callable[[Path, Path], None]:
    def change(workspace: Path, episode: Path) -> None:
        for folder in folder_of(workspace, episode):
            for path in sorted(folder.glob("*.png"), reverse=True):
                path.rename(folder / name(int(path.stem)))

    return change


def _depth_folders(_: Path, episode: Path) -> list[Path]:
    return sorted((episode / "recordings" / "depth").iterdir())


def _poses(convert: Callable[[np.ndarray], np.ndarray], *, notes: bool = True, one: bool = False) -> Callable:
    """Write the cameras' poses in another convention: matrix -> six numbers."""

    def change(_: Path, episode: Path) -> None:
        with h5py.File(episode / "trajectory.h5", "r+") as file:
            for serial, pose in exterior_poses().items():
                file[f"observation/camera_extrinsics/{serial}_left"][:] = convert(pose)
            if one:
                del file[f"observation/camera_type/{EXT2}"]
        if not notes:
            path = episode / "plop_episode.json"
            path.write_text(json.dumps({"tool": json.loads(path.read_text())["tool"]}))

    return _made(change)


def _axes(turn: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    def convert(pose: np.ndarray) -> np.ndarray:
        turned = pose.copy()
        turned[:3, :3] = pose[:3, :3] @ turn
        return pose6(turned)

    return convert


def _euler(order: str) -> Callable[[np.ndarray], np.ndarray]:
    return lambda pose: np.r_[pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_euler(order)]


OPENGL, ROS_BODY = np.diag([1.0, -1, -1]), np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]).T


def _depth_counts(per_m: float) -> Callable[[Path], None]:
    def change(_: Path, episode: Path) -> None:
        for path in episode.glob("recordings/depth/*/*.png"):
            metres = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 1000
            cv2.imwrite(str(path), np.round(metres * per_m).clip(0, 65534).astype(np.uint16))

    return _made(change)


def _masks(save: Callable[[Path, np.ndarray], None], name: str = "{:06d}.png") -> Callable[[Path], None]:
    def change(workspace: Path, episode: Path) -> None:
        scene, tools = Scene(), None
        with h5py.File(episode / "trajectory.h5") as file:
            flange = pose_from_euler_xyz(file["observation/robot_state/cartesian_position"][:])
        notes = json.loads((episode / "plop_episode.json").read_text())
        tools = flange @ pose_from_euler_xyz(np.array(notes["tool"]["flange_from_tool"]))
        for serial, pose in exterior_poses().items():
            folder = workspace / "masks" / NAME / serial
            folder.mkdir(parents=True)
            for frame, tool in enumerate(tools):
                save(folder / name.format(frame), scene.render(pose, tool, 1)[2])

    return _made(change)


def _palette(path: Path, labels: np.ndarray) -> None:
    picture = Image.fromarray(labels, mode="P")
    picture.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0] + [0] * 759)
    picture.save(path)


LATE = 3
"""First row of the interaction where frame 0 is never asked for."""


def _numbered_from_1_and_late(workspace: Path, episode: Path) -> None:
    """Each picture's only mark is a patch whose depth is its true frame; picture 000000 is never asked for."""
    for folder in _depth_folders(workspace, episode):
        for path in sorted(folder.glob("*.png"), reverse=True):
            depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            depth[:3, :3] = 1000 + 10 * int(path.stem)
            path.unlink()
            cv2.imwrite(str(folder / f"{int(path.stem) + 1:06d}.png"), depth)
    notes = json.loads((episode / "plop_episode.json").read_text())
    (episode / "plop_episode.json").write_text(json.dumps(notes | {"interaction": [LATE, ROWS - 1]}))


def _depth_is_of_its_frame(done: Done) -> None:
    with h5py.File(next((done.store.find("ingest@latest").path / "episodes").glob("*.h5"))) as file:
        for camera in file["cameras"].values():
            marks = camera["depth_m"][:, 1, 1]
            assert np.abs(marks - (1 + 0.01 * np.arange(LATE, LATE + len(marks)))).max() < 1e-4


def _av1(_: Path, episode: Path) -> None:
    import imageio_ffmpeg

    for path in episode.glob("recordings/MP4/*.mp4"):
        source = path.with_suffix(".old.mp4")
        path.rename(source)
        # libaom is the one AV1 encoder that every ffmpeg of imageio-ffmpeg has (7.0.2 lacks SVT-AV1).
        subprocess.run(
            [
                imageio_ffmpeg.get_ffmpeg_exe(),
                "-v",
                "error",
                "-i",
                source,
                "-c:v",
                "libaom-av1",
                "-crf",
                "5",
                "-cpu-used",
                "8",
                path,
            ],
            check=True,
            capture_output=True,
        )
        source.unlink()


def _hub_cache(folder: Path) -> None:
    snapshot = folder / "raw" / "datasets--me--cutting" / "snapshots" / "0a1b"
    shutil.copytree(_pristine(), snapshot)
    blobs = snapshot.parents[1] / "blobs"
    blobs.mkdir()
    for index, path in enumerate([snapshot / "knife.stl", *snapshot.rglob("*.mp4")]):
        shutil.move(path, blobs / f"9f86{index}")
        path.symlink_to(blobs / f"9f86{index}")


def _link_elsewhere(workspace: Path, _: Path) -> None:
    shutil.move(workspace / "raw" / "knife.stl", workspace / "blobs.stl")
    (workspace / "raw" / "knife.stl").symlink_to(workspace / "blobs.stl")


def _camera_names(workspace: Path, episode: Path) -> None:
    names = {EXT1: "cam_left", EXT2: "robot0_agentview_right_2"}
    with h5py.File(episode / "trajectory.h5", "r+") as file:
        for group in ("camera_type", "camera_extrinsics", "camera_intrinsics", "timestamp/cameras"):
            node = file[f"observation/{group}"]
            for key in list(node):
                for serial, name in names.items():
                    if key.startswith(serial):
                        node.move(key, name + key.removeprefix(serial))
    for path in [*episode.glob("recordings/MP4/*"), *episode.glob("recordings/depth/*")]:
        for serial, name in names.items():
            if path.name.startswith(serial):
                path.rename(path.with_name(name + path.name.removeprefix(serial)))


def _byte_order_mark(_: Path, episode: Path) -> None:
    for path in [episode / "plop_episode.json", *episode.glob("metadata*.json"), *episode.rglob("*_timestamps.json")]:
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())


def _top_and_bottom(_: Path, episode: Path) -> None:
    shutil.rmtree(episode / "recordings" / "depth")
    scene = Scene(160, 90, 115.0)
    for serial, pose in exterior_poses().items():
        eyes = [scene.render(eye, None, 1)[0] for eye in (pose, right_eye(pose, 0.06))]
        (episode / "recordings/MP4" / f"{serial}.mp4").unlink()
        write_video(episode / "recordings/MP4" / f"{serial}-stereo.mp4", [np.concatenate(eyes)] * ROWS)


def _right(done: Done) -> None:
    """Times as recorded; the object where it is, in every camera."""
    recordings = done.store.find("ingest@latest").path / "episodes"
    with h5py.File(next(recordings.glob("*.h5"))) as file:
        assert np.abs(np.diff(file["frames/time_s"][:]) - STEP_MS / 1000).max() < 1e-6
        assert len(file["frames/time_s"]) >= ROWS - 4 and len(file["cameras"]) == 2
        for camera in file["cameras"].values():
            use = (camera["mask"][0] == 1) & (camera["depth_m"][0] > 0)
            rows, columns = np.nonzero(use)
            k, pose, z = camera["intrinsics"][:], camera["world_from_cam"][0], camera["depth_m"][0][use]
            local = np.stack([(columns + 0.5 - k[0, 2]) / k[0, 0] * z, (rows + 0.5 - k[1, 2]) / k[1, 1] * z, z], -1)
            points = local @ pose[:3, :3].T + pose[:3, 3]
            low, high = np.percentile(points, [1, 99], axis=0)
            assert (low > BLOCK[0] - 0.012).all() and (high < BLOCK[1] + 0.012).all() and len(z) > 20


POSES, GL = "nerfstudio-project/nerfstudio#2259, RoboOrchardLab#22", "OpenGL / Blender camera axes"
EULER, CLOCK = "droid-dataset/droid#10", "OpenLORIS-Scene#28, chutsu/rs4se#1"
NUMBERED = "favyen/miris#4, UnaNancyOwen/rs_bag2image#5"
CONVENTION = ("another convention", "camera 11110001, 11110002", "Convert the poses")

CASES: list[Case] = [
    Case("droid_control", "", _made(lambda w, e: None), INGEST, never=("warning",), right=_right),
    Case(
        "droid_clock_seconds",
        CLOCK,
        _clocks(lambda t: t / 1000, lambda t: t / 1000),
        INGEST,
        warned=("in seconds (not milliseconds)",),
        right=_right,
    ),
    Case(
        "droid_clock_nanoseconds",
        CLOCK,
        _clocks(lambda t: t * 10**6 + 457, lambda t: t * 10**6 + 457),
        INGEST,
        warned=("in nanoseconds (not milliseconds)",),
        never=("no frame for",),
        right=_right,
    ),
    Case(
        "droid_clock_ns_and_ms",
        CLOCK,
        _clocks(lambda t: t * 10**6 + 999_999, lambda t: t),
        INGEST,
        warned=("in nanoseconds",),
        never=("no frame for",),
        right=_right,
    ),
    Case(
        "droid_clock_us_from_its_own_start",
        CLOCK,
        _clocks(lambda t: (t - 1_691_359_980_000) * 1000, lambda t: (t - 1_691_359_980_000) / 1000),
        INGEST,
        warned=("in microseconds", "in seconds"),
        right=_right,
    ),
    Case(
        "droid_clock_start_in_ms_then_seconds",
        CLOCK,
        _clocks(lambda t: t[0] + (t - t[0]) / 1000, lambda t: t[0] + (t - t[0]) / 1000),
        INGEST,
        refused=("duration of the recording", "in seconds it would span"),
    ),
    Case(
        "droid_clock_frame_numbers",
        CLOCK,
        _clocks(lambda t: np.arange(len(t)), lambda t: np.arange(len(t))),
        INGEST,
        refused=("frame numbers", "frame rate"),
    ),
    Case(
        "droid_clock_whole_seconds",
        CLOCK,
        _clocks(lambda t: t // 1000, lambda t: t // 1000),
        INGEST,
        refused=("clock",),
        never=("skip_action",),
    ),
    Case(
        "droid_depth_from_1",
        NUMBERED,
        _made(_rename(_depth_folders, lambda n: f"{n + 1:06d}.png")),
        INGEST,
        warned=("numbered from 1", "000001.png is taken as frame 0"),
        right=_right,
    ),
    Case(
        "droid_depth_from_1_late_start",
        NUMBERED,
        _made(_numbered_from_1_and_late),
        INGEST,
        warned=("numbered from 1",),
        right=_depth_is_of_its_frame,
    ),
    Case("droid_video_av1", "RoboticsData/score_lerobot_episodes#30", _made(_av1), INGEST, right=_right),
    Case(
        "droid_depth_five_digits_from_100",
        NUMBERED,
        _made(_rename(_depth_folders, lambda n: f"{n + 100:05d}.png")),
        INGEST,
        warned=("numbered from 100",),
        right=_right,
    ),
    Case(
        "droid_depth_twice_as_many_numbers",
        NUMBERED,
        _made(_rename(_depth_folders, lambda n: f"{2 * n:06d}.png")),
        INGEST,
        refused=("numbers of the depth images", "increase by 2"),
    ),
    Case(
        "droid_depth_of_a_d405",
        "realsenseai/librealsense#12918",
        _depth_counts(10_000),
        INGEST,
        refused=("depth is in another unit", "D405", "Multiply the depth images by 0.1"),
        never=("set workspace",),
    ),
    Case(
        "droid_depth_8_bit",
        "",
        _made(
            lambda w, e: [
                cv2.imwrite(str(p), np.full((48, 64), 90, np.uint8)) for p in e.glob("recordings/depth/*/*.png")
            ]
        ),
        INGEST,
        refused=("uint8", "scaled for display", "16-bit"),
    ),
    Case(
        "droid_depth_npy",
        "",
        _made(lambda w, e: [p.rename(p.with_suffix(".npy")) for p in e.glob("recordings/depth/*/*.png")]),
        INGEST,
        refused=("000000.npy", "16-bit PNG"),
    ),
    Case("droid_masks_palette", "tensorflow/datasets#2963", _masks(_palette), MASKS, right=_right),
    Case("droid_masks_five_digits", "SAM 2", _masks(_palette, "{:05d}.png"), MASKS, right=_right),
    Case(
        "droid_masks_0_255",
        "SysCV/sam-hq#42",
        _masks(lambda p, m: Image.fromarray(np.uint8(255 * (m == 1))).save(p)),
        MASKS,
        refused=("the values [0, 255]", "--binary-masks"),
    ),
    Case(
        "droid_masks_coloured",
        "",
        _masks(lambda p, m: Image.fromarray(np.uint8([[0, 0, 0], [128, 0, 0], [0, 128, 0]])[m]).save(p)),
        MASKS,
        refused=("RGB", "labels, not colours"),
    ),
    Case(
        "droid_hub_cache",
        "huggingface/transformers#46611",
        _hub_cache,
        ("ingest droid raw/datasets--me--cutting/snapshots/0a1b", "ingest droid raw"),
        right=_right,
    ),
    Case(
        "droid_link_elsewhere",
        "",
        _made(_link_elsewhere),
        INGEST,
        refused=("outside the raw folder", "a link to the outside"),
    ),
    Case("droid_camera_names", "RoboOrchardLab#22, robomimic#135", _made(_camera_names), INGEST, right=_right),
    Case("droid_byte_order_mark", "Windows editors", _made(_byte_order_mark), INGEST, never=("warning",), right=_right),
    Case(
        "droid_stereo_top_and_bottom",
        "nagadomi/nunif#163",
        _made(_top_and_bottom),
        INGEST,
        refused=("stacked vertically", "stereo3d=abl:sbsl"),
    ),
    Case("droid_poses_opengl", POSES, _poses(_axes(OPENGL)), INGEST, refused=(GL, *CONVENTION)),
    Case("droid_poses_opengl_one_camera", POSES, _poses(_axes(OPENGL), one=True), INGEST, refused=(GL,)),
    Case(
        "droid_poses_ros_body",
        POSES,
        _poses(_axes(ROS_BODY), notes=False),
        INGEST,
        refused=("ROS body axes", *CONVENTION),
    ),
    Case(
        "droid_poses_world_to_camera",
        POSES,
        _poses(lambda pose: pose6(np.linalg.inv(pose))),
        INGEST,
        refused=("world -> camera", *CONVENTION),
    ),
    Case("droid_poses_intrinsic_euler", EULER, _poses(_euler("XYZ")), INGEST, refused=("intrinsic XYZ", *CONVENTION)),
    Case(
        "droid_poses_intrinsic_euler_no_notes",
        EULER,
        _poses(_euler("XYZ"), notes=False),
        INGEST,
        refused=("intrinsic XYZ", *CONVENTION),
        never=("keep-untouched",),
    ),
    Case("droid_poses_zyx", EULER, _poses(_euler("ZYX")), INGEST, refused=("ZYX", *CONVENTION)),
]
