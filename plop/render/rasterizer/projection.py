"""Perspective projection of 3D Gaussians to 2D Gaussians (EWA splatting), in plain torch.

Source: Zwicker et al., "EWA Volume Splatting" (2001), Eqs. 23-31, with a low-pass filter, the near
plane and the clamped Jacobian of 3D Gaussian Splatting as in gsplat's mode "classic".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.geometry.rigid import quat_to_matrix
from plop.render.rasterizer.sh import sh_to_rgb

LOW_PASS_PX2 = 0.1
"""Variance added to both image axes of every 2D Gaussian [px^2]: a pixel's own, 1/12, and a little more. The usual 0.3
makes outlines and thin tools half a pixel wider."""
NEAR_M = 0.01
"""Gaussians whose centre is closer than this along the optical axis are not drawn [m]."""
FOV_MARGIN = 0.3
"""The Jacobian is evaluated at most this fraction of half the field of view outside the image."""
ALPHA_MAX = 0.999
"""Largest alpha of a Gaussian at a pixel."""
ALPHA_MIN = 1.0 / 255.0
"""Smallest alpha of a Gaussian at a pixel; lower ones are skipped."""
TRANSMITTANCE_MIN = 1e-4
"""A pixel is finished before the Gaussian that would lower its transmittance to this."""


@dataclass(frozen=True)
class Splats:
    """2D Gaussians in one image, nearest first."""

    means_px: Tensor
    """Image coordinates, shape [M, 2] [px]."""
    conics: Tensor
    """Inverse covariance (xx, xy, yy), shape [M, 3] [1/px^2]."""
    depth_m: Tensor
    """Depth of the centre along the optical axis, shape [M] [m]."""
    rgb: Tensor
    """Colour seen from the camera, shape [M, 3]."""
    opacities: Tensor
    """Peak opacity, shape [M]."""


def jacobian_limits(camera: Camera) -> tuple[float, float, float, float]:
    """Return the range of x/z and y/z within which the Jacobian is evaluated: (x low, x high, y low, y high)."""
    fx, fy = camera.intrinsics[0, 0], camera.intrinsics[1, 1]
    cx, cy = camera.intrinsics[0, 2], camera.intrinsics[1, 2]
    margin_x = FOV_MARGIN * 0.5 * camera.width / fx
    margin_y = FOV_MARGIN * 0.5 * camera.height / fy
    return (
        -(cx / fx + margin_x),
        (camera.width - cx) / fx + margin_x,
        -(cy / fy + margin_y),
        (camera.height - cy) / fy + margin_y,
    )


def project(gaussians: Gaussians, camera: Camera, near_m: float = NEAR_M) -> Splats:
    """Project those Gaussians that lie beyond the near plane, and sort them by depth (ties by index).

    Args:
        gaussians: N Gaussians, world frame.
        camera: The view; the skew of its intrinsics is ignored.
        near_m: Near plane [m].

    Returns:
        M <= N splats; their computation keeps the gradients and dtype of the Gaussians.
    """
    like = gaussians.means
    pose = torch.as_tensor(camera.cam_from_world, dtype=like.dtype, device=like.device)
    points = gaussians.means @ pose[:3, :3].T + pose[:3, 3]
    depth = points[:, 2].detach()
    order = torch.argsort(depth, stable=True)
    order = order[depth[order] > near_m]
    chosen, points = gaussians.select(order), points[order]

    covariances = _image_covariances(chosen, points, pose[:3, :3], camera)
    xx, xy, yy = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    conics = torch.stack([yy, -xy, xx], dim=-1) / (xx * yy - xy * xy)[:, None]

    focal = like.new_tensor([camera.intrinsics[0, 0], camera.intrinsics[1, 1]])
    centre = like.new_tensor([camera.intrinsics[0, 2], camera.intrinsics[1, 2]])
    means_px = points[:, :2] / points[:, 2:] * focal + centre
    eye = torch.as_tensor(camera.world_from_cam[:3, 3], dtype=like.dtype, device=like.device)
    directions = torch.nn.functional.normalize(chosen.means - eye, dim=-1)
    return Splats(means_px, conics, points[:, 2], sh_to_rgb(chosen.sh, directions), chosen.opacities)


def _image_covariances(gaussians: Gaussians, points: Tensor, cam_from_world: Tensor, camera: Camera) -> Tensor:
    """Transform covariances by the Jacobian of the projection at `points` (camera frame): [M, 2, 2] [px^2]."""
    fx, fy = float(camera.intrinsics[0, 0]), float(camera.intrinsics[1, 1])
    x_low, x_high, y_low, y_high = jacobian_limits(camera)
    z = points[:, 2]
    x_over_z = (points[:, 0] / z).clamp(x_low, x_high)
    y_over_z = (points[:, 1] / z).clamp(y_low, y_high)
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [
            torch.stack([fx / z, zero, -fx * x_over_z / z], dim=-1),
            torch.stack([zero, fy / z, -fy * y_over_z / z], dim=-1),
        ],
        dim=-2,
    )
    axes = quat_to_matrix(gaussians.quats) * gaussians.scales[:, None, :]
    half = jacobian @ (cam_from_world @ axes)
    return half @ half.transpose(-1, -2) + LOW_PASS_PX2 * torch.eye(2, dtype=z.dtype, device=z.device)
