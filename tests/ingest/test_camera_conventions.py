"""Conventions of camera poses are named from the table they show; a camera that is right is never accused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.cameras import Camera, look_at
from plop.geometry.pose_conventions import readings_of
from plop.geometry.rigid import pose_from_euler_xyz
from stages.ingest.camera_conventions import check_conventions
from stages.ingest.masks import Picture
from tests.support.droid_scene import TABLE_Z, WORKSPACE, Scene, pose6

BOX = np.array([WORKSPACE["min"], WORKSPACE["max"]])
GUESSED_BOX = np.array([[0.2, -0.45, -0.1], [0.85, 0.45, 0.5]])
TOOL = pose_from_euler_xyz(np.array([0.5, 0, 0.2, np.pi, 0, 0]))
SCENE = Scene(64, 48, 55.0)


def placed(rng: np.random.Generator) -> np.ndarray:
    """A camera anywhere above the table that looks at the object, rolled a little."""
    turn, rise, away = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(15, 80)), rng.uniform(0.35, 1.1)
    target = np.array([0.5, 0, 0.05]) + rng.normal(0, 0.04, 3)
    eye = target + away * np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    pose = look_at(eye, target, np.array([0, 0, 1.0]))
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("z", rng.normal(0, 0.1)).as_matrix()
    return pose


def seen(rng, cameras, write=pose6, depth_factor=1.0):
    """Noisy depth of cameras whose poses are 1 deg and 6 mm off, stored by `write`."""
    pictures, stored = {}, {}
    for number in range(cameras):
        truth = placed(rng)
        rgb, depth, _ = SCENE.render(truth, TOOL, 1)
        depth = depth * (1 + rng.normal(0, 0.005, depth.shape)) * (rng.random(depth.shape) > 0.2)
        off = truth.copy()
        off[:3, :3] = Rotation.from_rotvec(rng.normal(0, np.radians(1), 3)).as_matrix() @ truth[:3, :3]
        off[:3, 3] += rng.normal(0, 0.006, 3)
        stored[f"c{number}"] = write(off)
        camera = SCENE.camera(pose_from_euler_xyz(stored[f"c{number}"]), f"c{number}")
        pictures[f"c{number}"] = Picture(camera, rgb, (depth * depth_factor).astype(np.float32), TOOL)
    return pictures, stored


@pytest.mark.parametrize("seed", range(12))
def test_a_right_camera_is_never_accused(seed):
    pictures, stored = seen(np.random.default_rng(seed), 1 + seed % 3)
    for box, table in ((BOX, TABLE_Z), (GUESSED_BOX, None)):
        check_conventions(pictures, stored, box, table, "e")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("shift", "table"), [((0, 0, 0), 0.3), ((0, 0, 0), -0.2), ((0.6, 0, 0), TABLE_Z), ((0, 0, 1), 1)]
)
def test_a_wrong_workspace_or_table_is_not_blamed_on_right_cameras(seed, shift, table):
    pictures, stored = seen(np.random.default_rng(seed), 1 + seed % 2)
    check_conventions(pictures, stored, BOX + np.array(shift), table, "e")


def gl(pose):
    return pose6(pose @ np.diag([1.0, -1, -1, 1]))


def ros(pose):
    turn = np.eye(4)
    turn[:3, :3] = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]).T
    return pose6(pose @ turn)


def euler(order):
    return lambda pose: np.r_[pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_euler(order)]


CONVENTIONS = {
    "OpenGL": gl,
    "ROS body": ros,
    "world -> camera": lambda pose: pose6(np.linalg.inv(pose)),
    "camera -> world and OpenGL": lambda pose: pose6(np.linalg.inv(pose @ np.diag([1.0, -1, -1, 1]))),
    "intrinsic XYZ": euler("XYZ"),
    "extrinsic zyx": euler("zyx"),
    "intrinsic ZYX": euler("ZYX"),
    "rotation vector": lambda pose: np.r_[pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_rotvec()],
}


@pytest.mark.parametrize(("named", "write"), CONVENTIONS.items())
@pytest.mark.parametrize(("seed", "notes"), [(1, True), (2, False), (3, False)])
def test_a_convention_is_named(named, write, seed, notes):
    pictures, stored = seen(np.random.default_rng(seed), seed, write)
    box, table = (BOX, TABLE_Z) if notes else (GUESSED_BOX, None)
    with pytest.raises(PlopError) as caught:
        check_conventions(pictures, stored, box, table, "e")
    assert named in str(caught.value.found) and ", ".join(pictures) in str(caught.value.where)


@pytest.mark.parametrize(("factor", "named"), [(10.0, "D405"), (4.0, "L515"), (0.001, "in units of m")])
def test_a_unit_of_depth_is_named_with_its_factor(factor, named):
    pictures, stored = seen(np.random.default_rng(5), 2, depth_factor=factor)
    with pytest.raises(PlopError, match=named) as caught:
        check_conventions(pictures, stored, BOX, TABLE_Z, "e")
    assert f"by {1 / factor:g}" in str(caught.value.fix)


def test_the_first_reading_is_plops_own_and_all_give_rigid_poses():
    numbers = np.array([0.4, -0.2, 0.5, -2.1, 0.3, 0.7])
    readings = list(readings_of(numbers))
    assert readings[0].departures == () and np.allclose(readings[0].world_from_cam, pose_from_euler_xyz(numbers))
    assert all(np.allclose(r.world_from_cam[:3, :3] @ r.world_from_cam[:3, :3].T, np.eye(3)) for r in readings)
    assert len({r.departures for r in readings}) == len(readings)


def test_a_wall_and_an_object_alone_accuse_nobody():
    """Level cameras that see no table at all."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        pose = look_at(np.array([0.9, rng.uniform(-0.3, 0.3), 0.2]), np.array([0.3, 0, 0.2]), np.array([0, 0, 1.0]))
        camera = Camera("c", 64, 48, SCENE.intrinsics, pose)
        rays = camera.pixel_directions() @ pose[:3, :3].T
        depth = np.where(rays[..., 0] < 0, (pose[0, 3] + 0.2) / -rays[..., 0], 0).astype(np.float32)
        depth[20:40, 20:40] = 0.4
        picture = Picture(camera, np.zeros((48, 64, 3), np.uint8), depth, TOOL)
        for box, table in ((BOX, TABLE_Z), (GUESSED_BOX, None)):
            check_conventions({"c": picture}, {"c": pose6(pose)}, box, table, "e")
