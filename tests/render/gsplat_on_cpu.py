"""gsplat without its CUDA kernels: each replaced by gsplat's own plain-torch version.

Compositing is written by its kernel's rules. What is left of gsplat is its public function with its checks, its order
of arguments, its colours and its depth: what the backend of this package has to agree with.
"""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

_ALPHA_MAX, _ALPHA_MIN, _TRANSMITTANCE_MIN = 0.999, 1.0 / 255.0, 1e-4
"""RasterizeToPixels3DGSFwd.cu of gsplat 1.5.3."""


class Kernels:
    """Stand-ins for the five CUDA functions that `gsplat.rasterization` calls, packed form."""

    def __init__(self) -> None:
        self._images: Tensor | None = None

    def fully_fused_projection(
        self,
        means: Tensor,
        covars: None,
        quats: Tensor,
        scales: Tensor,
        viewmats: Tensor,
        Ks: Tensor,
        width: int,
        height: int,
        *,
        eps2d: float,
        packed: bool,
        near_plane: float,
        far_plane: float,
        camera_model: str,
        **_: Any,
    ) -> tuple[Tensor | None, ...]:
        """Project; gives what is visible, packed."""
        from gsplat.cuda import _torch_impl as own

        assert packed and covars is None
        turned, _precision = own._quat_scale_to_covar_preci(quats, scales, True, False, triu=False)
        radii, places, depths, conics, _no = own._fully_fused_projection(
            means,
            turned,
            viewmats,
            Ks,
            width,
            height,
            eps2d=eps2d,
            near_plane=near_plane,
            far_plane=far_plane,
            camera_model=camera_model,
        )
        cameras, ids = torch.nonzero((radii > 0).all(-1), as_tuple=True)
        self._images = cameras
        packed_values = (values[cameras, ids] for values in (radii, places, depths, conics))
        return torch.zeros_like(cameras), cameras, ids, *packed_values, None

    @staticmethod
    def spherical_harmonics(degree: int, dirs: Tensor, coeffs: Tensor, masks: Tensor | None = None) -> Tensor:
        """Colours from coefficients."""
        from gsplat.cuda import _torch_impl as own

        return own._spherical_harmonics(degree, torch.nn.functional.normalize(dirs, dim=-1), coeffs)

    @staticmethod
    def isect_tiles(places: Tensor, radii: Tensor, depths: Tensor, *_: Any, **__: Any) -> tuple[Tensor, Tensor, Tensor]:
        """No tiles: all Gaussians, nearest first."""
        order = torch.argsort(depths, stable=True)
        return order, order, order

    @staticmethod
    def isect_offset_encode(_: Tensor, images: int, columns: int, rows: int) -> Tensor:
        """No tiles."""
        return torch.zeros(images, rows, columns, dtype=torch.int64)

    def rasterize_to_pixels(
        self,
        places: Tensor,
        conics: Tensor,
        colors: Tensor,
        opacities: Tensor,
        width: int,
        height: int,
        tile_size: int,
        offsets: Tensor,
        order: Tensor,
        **_: Any,
    ) -> tuple[Tensor, Tensor]:
        """Composite Gaussian by Gaussian, all pixels at once."""
        assert self._images is not None
        views = int(offsets.shape[0])
        y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
        images, alphas = [], []
        for view in range(views):
            image, light = torch.zeros(height, width, colors.shape[-1]), torch.ones(height, width)
            done = torch.zeros(height, width, dtype=torch.bool)
            for k in order[self._images[order] == view]:
                dx, dy = x - places[k, 0], y - places[k, 1]
                a, b, c = conics[k]
                sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
                alpha = torch.clamp_max(opacities[k] * torch.exp(-sigma), _ALPHA_MAX)
                alpha = torch.where((sigma < 0) | (alpha < _ALPHA_MIN), 0.0, alpha)
                done = done | ((light * (1 - alpha) <= _TRANSMITTANCE_MIN) & (alpha > 0))
                alpha = torch.where(done, 0.0, alpha)
                image = image + (alpha * light)[..., None] * colors[k]
                light = light * (1 - alpha)
            images.append(image)
            alphas.append(1 - light)
        return torch.stack(images), torch.stack(alphas)[..., None]


def without_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let gsplat run on the CPU, and let this package's backend take CPU tensors for CUDA ones."""
    import gsplat.rendering

    kernels = Kernels()
    for name in (
        "fully_fused_projection",
        "spherical_harmonics",
        "isect_tiles",
        "isect_offset_encode",
        "rasterize_to_pixels",
    ):
        assert hasattr(gsplat.rendering, name), name
        monkeypatch.setattr(gsplat.rendering, name, getattr(kernels, name))
    monkeypatch.setattr(torch.Tensor, "is_cuda", property(lambda _: True), raising=False)
