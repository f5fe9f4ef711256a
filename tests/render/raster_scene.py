"""Random scenes for the tests of the rasterizer."""

import numpy as np
import torch
from torch import Tensor

from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera, look_at
from plop.render.rasterizer.interface import Rendering

FIELDS = ("means", "quats", "scales", "opacities", "sh")


def random_gaussians(count: int, *, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64).to(dtype)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64).to(dtype)

    return Gaussians(
        means=(uniform(count, 3) - 0.5) * torch.tensor([0.1, 0.1, 0.06], dtype=dtype),
        quats=normal(count, 4),
        scales=0.001 + 0.003 * uniform(count, 3),
        opacities=0.02 + 0.97 * uniform(count),
        sh=0.4 * normal(count, (degree + 1) ** 2, 3),
        ids=torch.arange(count),
    )


def camera_at(eye: tuple[float, float, float], *, width: int = 48, height: int = 40) -> Camera:
    """Look at the origin with a principal point off the middle and different focal lengths."""
    intrinsics = np.array([[1.7 * width, 0, 0.52 * width], [0, 1.8 * width, 0.47 * height], [0, 0, 1.0]])
    return Camera("test", width, height, intrinsics, look_at(np.array(eye), np.zeros(3), np.array([0.0, 0.0, 1.0])))


def with_gradients(gaussians: Gaussians, dtype: torch.dtype) -> Gaussians:
    leaves = {name: getattr(gaussians, name).detach().to(dtype).requires_grad_() for name in FIELDS}
    return gaussians.with_(**leaves)


def weighted_sum(renderings: list[Rendering], seed: int = 1) -> Tensor:
    """Reduce images to one number in which every pixel of rgb, depth and alpha has its own random weight."""
    generator = torch.Generator().manual_seed(seed)
    total = torch.zeros((), dtype=torch.float64)
    for rendering in renderings:
        for image in (rendering.rgb, rendering.depth_m, rendering.alpha):
            weights = torch.randn(image.shape, generator=generator, dtype=torch.float64)
            total = total + (image * weights.to(image)).sum().to(total)
    return total


def relative_error(found: Tensor, expected: Tensor) -> float:
    difference = (found.detach().double() - expected.detach().double()).norm()
    return float(difference / expected.detach().double().norm().clamp_min(1e-12))
