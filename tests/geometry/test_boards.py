"""Boards: drawn ones with known cameras, real images with a known answer, and none at all."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from plop.errors import PlopError
from plop.geometry.calibration.board_intrinsics import calibrate_intrinsics, read_images
from plop.geometry.calibration.boards import Board, board_pose, find_board
from plop.geometry.handeye.solve import difference
from plop.geometry.rigid import pose_from_euler_xyz

MATRIX = np.array([[600.0, 0, 322], [0, 602, 238], [0, 0, 1]])
CHARUCO = Board("charuco", 5, 7, 0.034, 0.028, "DICT_4X4_50")
CHESS = Board("chessboard", 8, 6, 0.025)
PX_PER_M = 4000


def flat_picture(board: Board) -> np.ndarray:
    """Draw the board face on, PX_PER_M pixels a metre, with a white rim of 0.02 m."""
    rim = int(0.02 * PX_PER_M)
    square = int(round(board.square_m * PX_PER_M))
    if board.kind == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, dictionary)
        pattern.setLegacyPattern(board.legacy)
        picture = pattern.generateImage((board.columns * square, board.rows * square))
    else:
        cells = np.indices((board.rows, board.columns)).sum(0) % 2
        picture = np.kron(255 * cells, np.ones((square, square))).astype(np.uint8)
    return np.pad(picture, rim, constant_values=255)


def photograph(board: Board, cam_from_board: np.ndarray) -> np.ndarray:
    """See the picture through a pinhole camera, twice oversampled; the board's origin is its first outer corner."""
    origin = 0.02 + (board.square_m if board.kind == "chessboard" else 0.0)
    to_metres = np.array(
        [[1 / PX_PER_M, 0, 0.5 / PX_PER_M - origin], [0, 1 / PX_PER_M, 0.5 / PX_PER_M - origin], [0, 0, 1]]
    )
    plane = cam_from_board[:3, [0, 1, 3]]
    finer = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
    picture = cv2.GaussianBlur(flat_picture(board), (0, 0), 1.2)
    big = cv2.warpPerspective(picture, finer @ MATRIX @ plane @ to_metres, (1280, 960), borderValue=128)
    return cv2.resize(big, (640, 480), interpolation=cv2.INTER_AREA)


def poses(count: int = 8) -> np.ndarray:
    draw = np.random.default_rng(3)
    parts = np.concatenate(
        [draw.uniform(-0.02, 0.02, (count, 3)) + [-0.08, -0.08, 0.4], draw.uniform(-0.4, 0.4, (count, 3))], axis=1
    )
    return pose_from_euler_xyz(parts)


@pytest.mark.parametrize("board", [CHARUCO, CHESS], ids=lambda board: board.kind)
def test_intrinsics_come_back(board):
    images = {f"{i}": photograph(board, pose) for i, pose in enumerate(poses())}
    found = calibrate_intrinsics(images, board)
    assert found.rms_px < 0.15 and len(found.missed) <= 1
    assert np.abs(found.matrix - MATRIX).max() < 6
    assert found.half_integer_matrix[0, 2] == found.matrix[0, 2] + 0.5


@pytest.mark.parametrize("board", [CHARUCO, CHESS], ids=lambda board: board.kind)
def test_the_pose_of_a_board_comes_back(board):
    for pose in poses(4):
        corners = find_board(photograph(board, pose), board)
        assert corners is not None
        found, error_px = board_pose(corners, MATRIX, np.zeros(5))
        angle, distance = difference(found, pose)
        if board.kind == "chessboard" and angle > 90:
            continue  # a chessboard with even sides looks the same turned around
        assert error_px < 0.3 and angle < 0.5 and distance < 1.5


def test_an_empty_image_shows_no_board():
    assert find_board(np.full((480, 640), 128, np.uint8), CHARUCO) is None
    assert find_board(np.full((480, 640), 128, np.uint8), CHESS) is None


def test_boards_in_no_image_are_an_error():
    blank = {str(i): np.full((480, 640, 3), 128, np.uint8) for i in range(4)}
    with pytest.raises(PlopError, match="too few images"):
        calibrate_intrinsics(blank, CHESS)


def test_mixed_sizes_are_an_error():
    with pytest.raises(PlopError, match="different sizes"):
        calibrate_intrinsics({"a": np.zeros((4, 4, 3), np.uint8), "b": np.zeros((5, 4, 3), np.uint8)}, CHESS)


@pytest.mark.parametrize(
    "board",
    [
        Board("chessboard", 12, 9, 25.0),
        Board("circles", 5, 7, 0.03),
        Board("charuco", 5, 7, 0.03, 0.04),
        Board("chessboard", 2, 9, 0.03),
        Board("charuco", 5, 7, 0.03, 0.02, "DICT_9X9"),
    ],
)
def test_impossible_boards_are_refused(board):
    with pytest.raises(PlopError):
        board.check()


def test_a_damaged_or_missing_image_is_named(tmp_path):
    with pytest.raises(PlopError, match="no images"):
        read_images(tmp_path / "nothing")
    (tmp_path / "a.png").write_bytes(b"not an image")
    with pytest.raises(PlopError, match="a.png"):
        read_images(tmp_path)


def test_real_chessboard_gives_the_known_intrinsics(shared_data):
    folder = shared_data / "handeye_ros2_realsense" / "camera_calibration" / "realsense"
    found = calibrate_intrinsics(read_images(folder), Board("chessboard", 12, 9, 0.025), where=folder)
    assert len(found.used) == 10
    assert found.rms_px == pytest.approx(0.1136, abs=5e-4)
    measured = found.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    np.testing.assert_allclose(measured, [615.99, 615.48, 314.66, 232.81], atol=0.02)


def test_real_marker_is_found_and_placed(shared_data):
    from stages.calibrate.handeye_folder import read_handeye

    folder = shared_data / "handeye_ros2_realsense" / "handeye_realsense" / "resource"
    matrix = np.array([[931.9412841796875, 0, 634.0355224609375], [0, 931.72412109375, 351.0355224609375], [0, 0, 1]])
    board = Board("marker", square_m=0.150, dictionary="DICT_ARUCO_ORIGINAL", marker_id=365)
    stored = read_handeye(folder).cam_from_board
    for image, pose in zip(read_images(folder).values(), stored):
        corners = find_board(image, board)
        assert corners is not None
        assert difference(board_pose(corners, matrix, np.zeros(5))[0], pose)[1] < 10
