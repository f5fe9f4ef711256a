"""Calibrate the intrinsics of a camera from images of a board (OpenCV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from plop.errors import PlopError
from plop.geometry.calibration.boards import Board, Corners, find_board, settle_pattern, what_was_tried

IMAGE_KINDS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True)
class Intrinsics:
    """The result of calibrating a camera."""

    matrix: np.ndarray
    """K, shape [3, 3] [px], OpenCV's convention: pixel centres at integers"""
    distortion: np.ndarray
    """k1, k2, p1, p2, k3"""
    rms_px: float
    """Root mean square reprojection error over all corners [px]."""
    width: int
    height: int
    used: list[str]
    """Images in which the board was found."""
    missed: list[str]
    """Images in which it was not."""
    board: Board
    """The board as it was found: its pattern may be the legacy one."""

    @property
    def half_integer_matrix(self) -> np.ndarray:
        """K in plop's convention (pixel centres at half-integers), shape [3, 3] [px]."""
        out = self.matrix.copy()
        out[:2, 2] += 0.5
        return out


def read_images(folder: Path) -> dict[str, np.ndarray]:
    """Read all images of a folder in the order of their names, colour BGR uint8.

    Raises:
        PlopError: There is no folder, no image, or one is damaged.
    """
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in IMAGE_KINDS) if folder.is_dir() else []
    if not paths:
        raise PlopError(
            "There are no images.",
            where=folder,
            expected=f"files {', '.join(IMAGE_KINDS)}",
            found="none" if folder.is_dir() else "no such folder",
        )
    images = {}
    for path in paths:
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None:
            raise PlopError(
                "An image cannot be read.", where=path, expected="a whole image file", fix="Copy it again or delete it."
            )
        images[path.name] = image
    return images


def calibrate_intrinsics(images: dict[str, np.ndarray], board: Board, *, where: str | Path = "") -> Intrinsics:
    """Calibrate a camera from images of a board (Zhang 2000, as in OpenCV's calibrateCamera).

    Args:
        images: Name -> image, all of one size, uint8.
        board: The board in them; not a single marker.
        where: Folder, named in errors.

    Raises:
        PlopError: Sizes differ, or the board is found in fewer than three images.
    """
    sizes = {image.shape[:2] for image in images.values()}
    if len(sizes) != 1:
        raise PlopError(
            "Images of one camera have different sizes.",
            where=where,
            expected="one size",
            found=", ".join(f"{w}x{h}" for h, w in sorted(sizes)) or "no image",
        )
    board = settle_pattern(images.values(), board)
    found = {name: find_board(image, board) for name, image in images.items()}
    usable: Sequence[Corners] = [corners for corners in found.values() if corners is not None]
    if len(usable) < 3:
        raise PlopError(
            "The board is found in too few images.",
            where=where,
            expected="at least 3 images",
            found=f"{len(usable)} of {len(images)}; {what_was_tried(images.values(), board)}",
            fix=f"Check kind, squares ({board.columns} x {board.rows}) and dictionary of the board, "
            "and that the whole board is sharp.",
        )
    height, width = sizes.pop()
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(
        [c.object_points for c in usable], [c.image_points for c in usable], (width, height), None, None
    )
    used = [name for name, corners in found.items() if corners is not None]
    return Intrinsics(
        matrix,
        distortion.reshape(-1),
        float(rms),
        width,
        height,
        used,
        [name for name in images if name not in used],
        board,
    )
