"""Rigid transforms on numpy arrays and quaternions on torch tensors.

A transform `world_from_cam` is a 4x4 matrix that takes camera coordinates to
world coordinates: X_world = world_from_cam @ X_cam. Quaternions are wxyz.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from plop.errors import PlopError
from plop.geometry.pose_matrices import TOLERANCE, matrix_fault, rigid_error


def invert_rigid(transform: np.ndarray) -> np.ndarray:
    """Invert rigid transforms without a general matrix inverse.

    Args:
        transform: Rigid 4x4 matrices, shape [..., 4, 4], translation in metres.

    Returns:
        Inverse transforms, shape [..., 4, 4].
    """
    rotation = np.swapaxes(transform[..., :3, :3], -1, -2)
    out = np.zeros_like(transform)
    out[..., :3, :3] = rotation
    out[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, transform[..., :3, 3])
    out[..., 3, 3] = 1.0
    return out


def check_rigid(poses: np.ndarray, where: str, *, what: str) -> None:
    """Reject poses that are not a rotation and a translation.

    Args:
        poses: One pose, or one a frame, shape [4, 4] or [T, 4, 4].
        where: File and key that hold them, for the message.
        what: Whose poses they are, for the message, e.g. "camera".

    Raises:
        PlopError: Numbers are not finite, the 3x3 part is scaled, mirrored or zero, or the last row is not 0 0 0 1.
    """
    stack = poses.reshape(-1, 4, 4)
    broken = ~np.isfinite(stack).all((1, 2))
    if broken.any():
        raise PlopError(
            f"A {what}'s pose has values that are not finite.",
            where=where,
            expected="finite poses",
            found=f"NaN or infinity{_of_frames(broken)}",
            fix="Track or export the poses again, or leave the episode out.",
        )
    wrong = (rigid_error(stack) > TOLERANCE) | (np.linalg.det(stack[:, :3, :3]) < 0)
    if wrong.any():
        found = matrix_fault(stack[int(np.argmax(wrong))])
        raise PlopError(
            f"A {what}'s pose is not a rotation and a translation.",
            where=where,
            expected="an orthonormal right-handed 3x3 part over the last row 0 0 0 1",
            found=f"{found}{_of_frames(wrong)}",
            fix="Transpose the matrices: translation in the last column."
            if "transposed" in found
            else "Write 4x4 poses without scale, translation in the last column.",
        )


def _of_frames(wrong: np.ndarray) -> str:
    return f" in {int(wrong.sum())} of {len(wrong)} poses, first at {int(np.argmax(wrong))}" if len(wrong) > 1 else ""


def transform_points(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points by one rigid transform.

    Args:
        transform: Shape [4, 4].
        points: Shape [..., 3], metres.

    Returns:
        Moved points, shape [..., 3], metres.
    """
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def kabsch(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the rigid transform with the least squared distance between paired points.

    Args:
        source: Shape [N, 3], metres.
        target: Shape [N, 3], metres.

    Returns:
        Shape [4, 4].
    """
    middle, goal = source.mean(0), target.mean(0)
    left, _, right = np.linalg.svd((source - middle).T @ (target - goal))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    pose = np.eye(4)
    pose[:3, :3] = right.T @ flip @ left.T
    pose[:3, 3] = goal - pose[:3, :3] @ middle
    return pose


def pose_from_quat_wxyz(position: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    """Build 4x4 poses from positions [..., 3] (metres) and quaternions [..., 4] (wxyz)."""
    quat = np.asarray(quat_wxyz, dtype=np.float64)
    out = np.zeros((*quat.shape[:-1], 4, 4))
    xyzw = quat[..., [1, 2, 3, 0]].reshape(-1, 4)
    out[..., :3, :3] = Rotation.from_quat(xyzw).as_matrix().reshape(*quat.shape[:-1], 3, 3)
    out[..., :3, 3] = position
    out[..., 3, 3] = 1.0
    return out


def pose_from_euler_xyz(pose6: np.ndarray) -> np.ndarray:
    """Build 4x4 poses from [x, y, z, a, b, c]: metres and extrinsic xyz Euler angles in radians.

    This is DROID's convention for camera and flange poses.
    """
    pose6 = np.asarray(pose6, dtype=np.float64)
    out = np.zeros((*pose6.shape[:-1], 4, 4))
    rotation = Rotation.from_euler("xyz", pose6[..., 3:].reshape(-1, 3)).as_matrix()
    out[..., :3, :3] = rotation.reshape(*pose6.shape[:-1], 3, 3)
    out[..., :3, 3] = pose6[..., :3]
    out[..., 3, 3] = 1.0
    return out


def quat_to_matrix(quats: Tensor) -> Tensor:
    """Turn quaternions (wxyz, any length but zero) into rotation matrices, [..., 4] -> [..., 3, 3]."""
    w, x, y, z = torch.nn.functional.normalize(quats, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(rows, dim=-1).reshape(*quats.shape[:-1], 3, 3)


def matrix_to_quat(matrices: Tensor) -> Tensor:
    """Turn rotation matrices into unit quaternions wxyz with w >= 0, [..., 3, 3] -> [..., 4]; no gradient."""
    flat = matrices.detach().cpu().double().reshape(-1, 3, 3).numpy()
    xyzw = Rotation.from_matrix(flat).as_quat() if len(flat) else np.zeros((0, 4))
    wxyz = torch.from_numpy(xyzw[:, [3, 0, 1, 2]])
    wxyz = torch.where(wxyz[:, :1] < 0, -wxyz, wxyz)
    return wxyz.to(matrices).reshape(*matrices.shape[:-2], 4)


def quat_multiply(left: Tensor, right: Tensor) -> Tensor:
    """Compose rotations: the result rotates by `right` first, then by `left`; shapes [..., 4], wxyz."""
    lw, lx, ly, lz = left.unbind(-1)
    rw, rx, ry, rz = right.unbind(-1)
    return torch.stack(
        [
            lw * rw - lx * rx - ly * ry - lz * rz,
            lw * rx + lx * rw + ly * rz - lz * ry,
            lw * ry - lx * rz + ly * rw + lz * rx,
            lw * rz + lx * ry - ly * rx + lz * rw,
        ],
        dim=-1,
    )


def quat_conjugate(quats: Tensor) -> Tensor:
    """Invert unit quaternions, [..., 4] -> [..., 4], wxyz."""
    return quats * quats.new_tensor([1.0, -1.0, -1.0, -1.0])


def quat_from_rotation_vector(vectors: Tensor) -> Tensor:
    """Turn rotation vectors (axis times angle, radians) into unit quaternions, [..., 3] -> [..., 4].

    Smooth at zero: sin(a/2)/a is replaced by its series below 1e-4 rad.
    """
    squared = vectors.square().sum(-1, keepdim=True)
    safe = squared.clamp_min(1e-12).sqrt()
    small = squared < 1e-8
    factor = torch.where(small, 0.5 - squared / 48, torch.sin(safe / 2) / safe)
    real = torch.where(small, 1 - squared / 8, torch.cos(safe / 2))
    return torch.nn.functional.normalize(torch.cat([real, factor * vectors], dim=-1), dim=-1)


def rotation_vector_from_quat(quats: Tensor) -> Tensor:
    """Turn unit quaternions into rotation vectors with angle in [0, pi], [..., 4] -> [..., 3]."""
    quats = torch.where(quats[..., :1] < 0, -quats, quats)
    length = quats[..., 1:].norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(length, quats[..., :1])
    factor = torch.where(length < 1e-7, torch.full_like(length, 2.0), angle / length.clamp_min(1e-12))
    return factor * quats[..., 1:]
