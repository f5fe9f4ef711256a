"""The CUDA backend: gsplat behind the interface of this package."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.installed import install_extra
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.projection import LOW_PASS_PX2
from plop.render.rasterizer.sh import TERMS_OF_DEGREE


def render_gsplat(gaussians: Gaussians, cameras: list[Camera], background: Tensor, near_m: float) -> list[Rendering]:
    """Render on a CUDA device in float32 with gsplat's mode "classic".

    Args:
        gaussians: N Gaussians, world frame, on a CUDA device.
        cameras: The views, all of one size.
        background: Colour behind everything, shape [3].
        near_m: Near plane [m].

    Returns:
        One view per camera, in the dtype of the means, differentiable by autograd.

    Raises:
        PlopError: The tensors are not on a CUDA device, or gsplat is not installed.
    """
    if not gaussians.means.is_cuda:
        raise PlopError(
            "gsplat renders on CUDA devices only.",
            found=f"Gaussians on {gaussians.means.device}, CUDA {'' if torch.cuda.is_available() else 'not '}available",
            fix="Choose the backend auto or numba, or a device with CUDA; `plop doctor` shows those that torch finds.",
        )
    try:
        from gsplat import rasterization
    except ImportError as error:
        fix = f"{install_extra('cuda')}; it also needs the CUDA toolkit to compile."
        raise PlopError("gsplat is not installed.", found=str(error), fix=fix) from error

    like, (width, height) = gaussians.means, (cameras[0].width, cameras[0].height)
    if len(gaussians) == 0:
        empty = like.new_zeros(height, width)
        return [Rendering(background.expand(height, width, 3), empty, empty) for _ in cameras]
    images, alphas, _ = rasterization(
        **{name: getattr(gaussians, name).float() for name in ("means", "quats", "scales", "opacities")},
        colors=gaussians.sh.float(),
        viewmats=_on_device([camera.cam_from_world for camera in cameras], like),
        Ks=_on_device([camera.intrinsics for camera in cameras], like),
        width=width,
        height=height,
        sh_degree=TERMS_OF_DEGREE.index(gaussians.sh.shape[1]),
        render_mode="RGB+ED",
        near_plane=near_m,
        eps2d=LOW_PASS_PX2,
    )
    images, alphas = images.to(like), alphas.to(like)
    rgb = images[..., :3] + (1 - alphas) * background
    views = zip(rgb, images[..., 3], alphas[..., 0], strict=True)
    return [Rendering(*view) for view in views]


def _on_device(matrices: list[np.ndarray], like: Tensor) -> Tensor:
    return torch.as_tensor(np.stack(matrices), dtype=torch.float32, device=like.device)
