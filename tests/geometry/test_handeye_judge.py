"""Hand-eye poses are judged: right ones pass, wrong ones are named, others are refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.geometry.handeye.fit import fit_hand_eye
from plop.geometry.handeye.judge import judge_hand_eye, moving_poses
from plop.geometry.handeye.judgement import HandEyeFault
from plop.geometry.handeye.readings import OTHER_MOUNT
from plop.geometry.handeye.solve import difference, hand_eye
from plop.geometry.pose_matrices import is_transposed, matrix_fault
from plop.geometry.rigid import check_rigid, invert_rigid, pose_from_euler_xyz
from stages.calibrate.handeye_folder import read_handeye
from tests.support.handeye_sets import draw_rig, stretched, turned


def test_right_sets_are_accepted():
    faults = [judge_hand_eye(rig.robot, rig.board, rig.mount).fault for rig in map(draw_rig, range(20))]
    assert faults.count(HandEyeFault.NONE) >= 19


@pytest.mark.parametrize("size", [0.3, 4.0])
def test_right_sets_of_other_sizes_are_accepted(size):
    rigs = [draw_rig(seed, size=size, noise_mm=1.0) for seed in range(8)]
    assert all(judge_hand_eye(rig.robot, rig.board, rig.mount).fault is HandEyeFault.NONE for rig in rigs)


def test_the_fit_finds_the_answer_and_knows_its_error():
    ratios, inside = [], 0
    for seed in range(20):
        rig = draw_rig(seed, noise_mm=1.0, noise_deg=0.1)
        moving = moving_poses(rig.robot, rig.mount)
        fit, scaled = fit_hand_eye(moving, rig.board), fit_hand_eye(moving, rig.board, free_scale=True)
        points = rig.board[:, :3, 3] @ (fit.moving_from_cam - rig.answer)[:3, :3].T
        points += (fit.moving_from_cam - rig.answer)[:3, 3]
        ratios.append(1e3 * np.sqrt((points**2).sum(1).mean()) / fit.uncertainty_mm)
        inside += scaled.scale_interval[0] <= 1 <= scaled.scale_interval[1]
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5
    assert inside == 20


def as_text(poses: np.ndarray) -> np.ndarray:
    return poses[np.array(sorted(range(len(poses)), key=lambda i: str(i + 1)))]


WRONG = {
    "robot poses are inverted": lambda r, b, m: (invert_rigid(r), b, m),
    "board poses are inverted": lambda r, b, m: (r, invert_rigid(b), m),
    "both inverted": lambda r, b, m: (invert_rigid(r), invert_rigid(b), m),
    "mounted differently": lambda r, b, m: (r, b, OTHER_MOUNT[m]),
    "scale 0.8": lambda r, b, m: (r, stretched(b, 1.2), m),
    "scale 1.1": lambda r, b, m: (r, stretched(b, 0.9), m),
    "positions are in millimetres": lambda r, b, m: (stretched(r, 0.001), b, m),
    "quaternions are w, x, y, z": lambda r, b, m: (
        turned(r, lambda turns: Rotation.from_quat(turns.as_quat()[:, [3, 0, 1, 2]])),
        b,
        m,
    ),
    "Euler angles x, y, z about rotating axes": lambda r, b, m: (
        turned(r, lambda turns: Rotation.from_euler("xyz", turns.as_euler("XYZ"))),
        b,
        m,
    ),
    "a rotation vector": lambda r, b, m: (r, turned(b, lambda t: Rotation.from_euler("xyz", t.as_rotvec())), m),
    "sorted as text": lambda r, b, m: (as_text(r), b, m),
    "off by 1": lambda r, b, m: (r[1:], b[:-1], m),
    "transposed": lambda r, b, m: (r, turned(b, lambda turns: turns.inv()), m),
    "pair 3 (counted from 0) does not belong": lambda r, b, m: (r, np.concatenate([b[:3], b[8:9], b[4:]]), m),
}


@pytest.mark.parametrize("name", list(WRONG))
def test_what_is_wrong_is_named(name):
    for seed in (0, 1):
        rig = draw_rig(seed, pairs=14, turn_deg=30, noise_mm=0.8, noise_deg=0.1)
        judged = judge_hand_eye(*WRONG[name](rig.robot, rig.board, rig.mount))
        assert judged.fault is not HandEyeFault.NONE and name in judged.why()


def test_pairs_that_do_not_belong_together_are_refused_without_a_name():
    rig = draw_rig(0, pairs=14, turn_deg=30)
    mixed = np.random.default_rng(0).permutation(14)
    judged = judge_hand_eye(rig.robot, rig.board[mixed], rig.mount)
    assert judged.fault is HandEyeFault.INCONSISTENT and not judged.likely + judged.unlikely
    assert "the robot rotates by" in judged.why() and "pairs belong together" in judged.why()


def test_motion_about_one_axis_leaves_the_answer_open():
    """Noise makes other axes of the turns, but no answer: an error along the axis stays."""
    rig = draw_rig(0, mount="wrist", pairs=12, noise_mm=0.0, noise_deg=0.0)
    parts = np.tile([0.4, 0, 0.4, np.pi, 0, 0], (12, 1)).astype(float)
    parts[:, 5] = np.linspace(-0.3, 0.3, 12)
    draw = np.random.default_rng(0)
    robot = pose_from_euler_xyz(parts + np.r_[0, 0, 0, 1, 1, 1] * draw.normal(0, 0.02, (12, 6)))
    board = invert_rigid(robot @ rig.answer) @ pose_from_euler_xyz(np.array([0.4, 0, 0, 0, 0, 0]))
    board = board @ pose_from_euler_xyz(draw.normal(0, 0.004, (12, 6)))
    judged = judge_hand_eye(robot, board, "wrist")
    assert judged.fault is HandEyeFault.UNDETERMINED and "about two axes" in judged.why()


@pytest.mark.parametrize("seed", range(6))
def test_radians_that_were_read_as_degrees_are_named(seed):
    """The turns are tiny: too small to be judged, or small about one axis for the flip at half a turn."""
    rig = draw_rig(seed, pairs=14, turn_deg=25)
    small = turned(rig.robot, lambda turns: Rotation.from_euler("xyz", turns.as_euler("xyz") * np.pi / 180))
    try:
        said = judge_hand_eye(small, rig.board, rig.mount).why()
    except PlopError as error:
        said = error.render()
    assert "radians" in said and "read as degrees" in said


def test_an_uncertain_scale_is_not_called_wrong():
    rig = draw_rig(3, mount="fixed", pairs=6, noise_mm=3, noise_deg=0.3, turn_deg=12)
    judged = judge_hand_eye(rig.robot, stretched(rig.board, 1.02), "fixed")
    assert not judged.scale_is_off and judged.fault is not HandEyeFault.SCALE


def test_hand_eye_itself_refuses_what_is_inconsistent():
    rig = draw_rig(0, pairs=14, turn_deg=30)
    with pytest.raises(PlopError, match="inverted"):
        hand_eye(invert_rigid(rig.robot), rig.board, mount=rig.mount)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda pose: pose.T, "transposed"),
        (lambda pose: pose @ np.diag([1.2, 1.2, 1.2, 1]), "scaled by 1.2"),
        (lambda pose: pose @ np.diag([1, 1, -1, 1]), "mirrored"),
        (lambda pose: pose + np.eye(4)[3][:, None] * 0.5, "last row"),
        (lambda pose: pose, ""),
    ],
)
def test_a_matrix_that_is_not_rigid_is_described(change, fault):
    pose = change(draw_rig(0).answer)
    assert fault in matrix_fault(pose) and (fault or not matrix_fault(pose))
    if fault:
        with pytest.raises(PlopError, match=fault):
            check_rigid(pose, "a file", what="robot")


def test_a_transposed_pose_is_told_by_its_translation():
    poses = draw_rig(0).robot
    assert is_transposed(np.swapaxes(poses, 1, 2)) and not is_transposed(poses)
    assert not is_transposed(np.tile(np.eye(4), (3, 1, 1)))
    mixed = poses.copy()
    mixed[2] = mixed[2].T
    assert not is_transposed(mixed)


def real_sets(shared_data):
    ros2 = read_handeye(shared_data / "handeye_ros2_realsense" / "handeye_realsense" / "resource")
    franka = read_handeye(shared_data / "franka_handeye" / "data" / "captured-data")
    moveit = np.array(json.loads((shared_data / "moveit_handeye" / "pose_samples.json").read_text()))
    return [
        (ros2.base_from_gripper, ros2.cam_from_board, "wrist"),
        (franka.base_from_gripper, franka.cam_from_board, "wrist"),
        (moveit[:, 0], moveit[:, 1], "fixed"),
    ]


def test_real_sets_pass_and_their_wrong_readings_are_named(shared_data):
    for robot, board, mount in real_sets(shared_data):
        assert judge_hand_eye(robot, board, mount).fault is HandEyeFault.NONE
        robot, board = robot[:12], board[:12]  # the others cost time only
        for name in ("robot poses are inverted", "both inverted", "scale 0.8", "off by 1"):
            judged = judge_hand_eye(*WRONG[name](robot, board, mount))
            assert judged.fault is not HandEyeFault.NONE and name in judged.why()


def test_moveit_answer_is_the_published_one(shared_data):
    robot, board, mount = real_sets(shared_data)[2]
    found = hand_eye(robot, board, mount=mount).result
    assert np.abs(found[:3, 3] - [0.659, -0.249, 0.830]).max() < 0.002
    with pytest.raises(PlopError, match="handeye-mount fixed"):
        hand_eye(robot, board, mount="wrist")


def test_column_major_files_of_a_real_robot_give_the_same_answer(shared_data, tmp_path):
    source = shared_data / "franka_handeye" / "data" / "captured-data"
    for path in sorted(source.glob("pose_*/data.json")):
        facts = json.loads(path.read_text())
        facts["O_T_EE"] = np.reshape(facts["O_T_EE"], (4, 4)).T.ravel().tolist()
        (tmp_path / path.parent.name).mkdir()
        (tmp_path / path.parent.name / "data.json").write_text(json.dumps(facts))
    rows, columns = read_handeye(source), read_handeye(tmp_path)
    assert not rows.notes and columns.notes == ["the robot's matrices are column-major: transposed"]
    answers = [hand_eye(each.base_from_gripper, each.cam_from_board).result for each in (rows, columns)]
    assert max(difference(*answers)) < 1e-3
