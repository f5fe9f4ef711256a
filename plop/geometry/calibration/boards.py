"""Find calibration boards in images (OpenCV)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np

from plop.errors import PlopError

BoardKind = Literal["charuco", "chessboard", "marker"]
MIN_CORNERS = 6
"""Fewer corners of a ChArUco board than this are not used."""


@dataclass(frozen=True)
class Board:
    """A flat calibration board."""

    kind: BoardKind
    """"chessboard", "charuco", or "marker" (one ArUco tag)."""
    columns: int = 0
    """Squares along x; of a chessboard the inner corners are one fewer."""
    rows: int = 0
    """Squares along y."""
    square_m: float = 0.0
    """Edge of a square; of a marker its own edge [m]."""
    marker_m: float = 0.0
    """Edge of the ArUco markers in a ChArUco board [m]."""
    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the ArUco dictionary."""
    marker_id: int = 0
    """Of a single marker."""
    legacy: bool = False
    """A ChArUco board as OpenCV drew it before 4.6 (and calib.io does): with an even number of rows its first square
    is white, not black. Nobody has to know: `settle_pattern` tells by the images."""

    def check(self) -> None:
        """Raise a PlopError when the description cannot be."""
        if self.kind not in get_args(BoardKind):
            raise PlopError(
                "The kind of board is unknown.",
                where="board_kind",
                expected=" or ".join(get_args(BoardKind)),
                found=self.kind,
            )
        if self.kind != "marker" and (self.columns < 3 or self.rows < 3):
            raise PlopError(
                "The board has too few squares.",
                where="board_columns, board_rows",
                expected="at least 3 x 3 squares",
                found=f"{self.columns} x {self.rows}",
                fix="Count squares, not inner corners.",
            )
        if not 0 < self.square_m < 1:
            raise PlopError(
                "A square of the board has an impossible size.",
                where="board_square_m",
                expected="metres, below 1",
                found=f"{self.square_m}",
                fix="Give metres, not millimetres.",
            )
        if self.kind == "charuco" and not 0 < self.marker_m < self.square_m:
            raise PlopError(
                "The markers of a ChArUco board are smaller than its squares.",
                where="board_marker_m",
                expected=f"0 < marker < {self.square_m} m",
                found=f"{self.marker_m} m",
                fix="Measure both, edge to edge.",
            )
        if self.kind != "chessboard" and not hasattr(cv2.aruco, self.dictionary):
            raise PlopError(
                "The ArUco dictionary is unknown.",
                where="board_dictionary",
                expected="a name as OpenCV's DICT_4X4_50",
                found=self.dictionary,
            )


@dataclass(frozen=True)
class Corners:
    """Corners of the board in one image."""

    object_points: np.ndarray
    """[N, 3] float32, on the board, z = 0 [m]"""
    image_points: np.ndarray
    """[N, 2] float32 [px], OpenCV's convention: pixel centres at integers"""


def find_board(image: np.ndarray, board: Board) -> Corners | None:
    """Find a board in an image.

    Args:
        image: Grey [H, W] or colour [H, W, 3], uint8.
        board: What to look for.

    Returns:
        Its corners, refined below a pixel; None when it is not there.
    """
    board.check()
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    finder = {"chessboard": _chessboard, "charuco": _charuco, "marker": _marker}[board.kind]
    return finder(grey, board)


def _chessboard(grey: np.ndarray, board: Board) -> Corners | None:
    size = (board.columns - 1, board.rows - 1)
    found, corners = cv2.findChessboardCorners(grey, size)
    if not found:
        return None
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.001)
    corners = cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), criteria)
    grid = np.zeros((size[0] * size[1], 3), np.float32)
    grid[:, :2] = np.mgrid[0 : size[0], 0 : size[1]].T.reshape(-1, 2) * board.square_m
    return Corners(grid, corners.reshape(-1, 2))


def _dictionary(board: Board) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))


def _charuco(grey: np.ndarray, board: Board) -> Corners | None:
    pattern = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, _dictionary(board))
    pattern.setLegacyPattern(board.legacy)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(grey)
    if ids is None or len(ids) < MIN_CORNERS:
        return None
    grid = pattern.getChessboardCorners()[ids.reshape(-1)]
    return Corners(np.asarray(grid, np.float32), corners.reshape(-1, 2).astype(np.float32))


def settle_pattern(images: Iterable[np.ndarray], board: Board) -> Board:
    """Tell whether a ChArUco board is drawn in the present or the legacy pattern, by which shows more corners.

    The two differ where the number of rows is even; any other board is given back as it is.

    Args:
        images: Of one board, uint8.
        board: As described by the user.
    """
    if board.kind != "charuco" or board.rows % 2:
        return board
    seen = dict.fromkeys((board.legacy, not board.legacy), 0)
    for image in images:
        for legacy in seen:
            corners = find_board(image, replace(board, legacy=legacy))
            seen[legacy] += 0 if corners is None else len(corners.image_points)
    return replace(board, legacy=max(seen, key=lambda legacy: seen[legacy]))


def what_was_tried(images: Iterable[np.ndarray], board: Board) -> str:
    """Say what a board that was not found was looked for as, and whether its squares may be swapped."""
    size = f"{board.columns} x {board.rows}"
    if board.kind == "marker":
        return f"looked for marker {board.marker_id} of {board.dictionary}"
    tried = f"looked for {size} squares"
    if board.kind == "charuco":
        patterns = ", in OpenCV's pattern and the legacy one (before 4.6)" if board.rows % 2 == 0 else ""
        tried += f" with markers of {board.dictionary}{patterns}"
    pictures, turned = list(images), replace(board, columns=board.rows, rows=board.columns)
    turned = settle_pattern(pictures, turned)
    found = sum(find_board(image, turned) is not None for image in pictures)
    return tried + (f"; with {turned.columns} x {turned.rows} it is found in {found}" if found else "")


def _marker(grey: np.ndarray, board: Board) -> Corners | None:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(_dictionary(board), parameters).detectMarkers(grey)
    for corner, found in zip(corners, [] if ids is None else ids.reshape(-1), strict=True):
        if found == board.marker_id:
            half = board.square_m / 2
            square = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]], np.float32)
            return Corners(square, corner.reshape(4, 2).astype(np.float32))
    return None


def board_pose(corners: Corners, matrix: np.ndarray, distortion: np.ndarray) -> tuple[np.ndarray, float]:
    """Place a board before the camera.

    Args:
        corners: Of one image.
        matrix: K, shape [3, 3], pixel centres at integers [px].
        distortion: OpenCV's coefficients.

    Returns:
        cam_from_board, shape [4, 4] [m], and the root mean square reprojection error [px].

    Raises:
        PlopError: No pose fits the corners.
    """
    flag = cv2.SOLVEPNP_IPPE_SQUARE if len(corners.object_points) == 4 else cv2.SOLVEPNP_IPPE
    found, rotation, translation = cv2.solvePnP(
        corners.object_points, corners.image_points, matrix, distortion, flags=flag
    )
    if not found:
        raise PlopError("No pose of the board fits its corners.", found=f"{len(corners.object_points)} corners")
    rotation, translation = cv2.solvePnPRefineLM(
        corners.object_points, corners.image_points, matrix, distortion, rotation, translation
    )
    drawn, _ = cv2.projectPoints(corners.object_points, rotation, translation, matrix, distortion)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(rotation)[0], translation.reshape(3)
    error = np.linalg.norm(drawn.reshape(-1, 2) - corners.image_points, axis=1)
    return pose, float(np.sqrt(np.mean(error**2)))
