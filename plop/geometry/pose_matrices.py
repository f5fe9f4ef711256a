"""Checks of 4x4 matrices that should be rigid transforms, and of transposed ones."""

from __future__ import annotations

import numpy as np

TOLERANCE = 1e-2
"""Largest deviation of an entry from a rigid matrix's: numbers rounded to two digits pass."""
LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def rigid_error(poses: np.ndarray) -> np.ndarray:
    """Return how far matrices are from rigid ones (mirrored ones apart): largest entry of R Rt - 1 and of the last row.

    Args:
        poses: Finite, shape [N, 4, 4].

    Returns:
        Shape [N].
    """
    part = poses[:, :3, :3]
    error = np.abs(part @ np.swapaxes(part, 1, 2) - np.eye(3)).max((1, 2))
    return np.asarray(np.maximum(error, np.abs(poses[:, 3] - LAST_ROW).max(1)))


def is_transposed(poses: np.ndarray) -> bool:
    """Return whether matrices are rigid only when read by columns, as libfranka, OpenGL and USD write them.

    The 3x3 part of a transposed pose is a rotation, too: the translation in the last row of at least one of them
    decides; where all translations are zero, they are used as given.
    """
    return bool((rigid_error(poses) > TOLERANCE).any() and (rigid_error(np.swapaxes(poses, 1, 2)) <= TOLERANCE).all())


def matrix_fault(pose: np.ndarray) -> str:
    """Describe why a matrix is not a rigid transform; "" when it is one.

    Args:
        pose: Finite, shape [4, 4].
    """
    part = pose[:3, :3]
    if rigid_error(pose[None])[0] <= TOLERANCE:
        return "a mirrored 3x3 part" if np.linalg.det(part) < 0 else ""
    if is_transposed(pose[None]):
        return "the translation in the last row (column by column: transposed)"
    scale = np.sqrt(np.trace(part @ part.T) / 3)
    if scale > 0 and rigid_error(_with(pose, part / scale)[None])[0] <= TOLERANCE:
        return f"a 3x3 part scaled by {scale:.4g}" + (" and mirrored" if np.linalg.det(part) < 0 else "")
    off = f"off by {rigid_error(pose[None])[0]:.3g}"
    if np.linalg.det(part) < 0:
        return f"a mirrored 3x3 part, {off}"
    if np.abs(pose[3] - LAST_ROW).max() > TOLERANCE:
        return f"{off}, with the last row {' '.join(f'{value:.3g}' for value in pose[3])}"
    return off


def _with(pose: np.ndarray, part: np.ndarray) -> np.ndarray:
    out = pose.copy()
    out[:3, :3] = part
    return out
