"""The entry point of the rasterizer: check the input, choose a backend, render."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.cameras import Camera
from plop.render.rasterizer.interface import Rendering
from plop.render.rasterizer.numba_check import OPACITY_HIGH, OPACITY_LOW, is_sound
from plop.render.rasterizer.projection import NEAR_M
from plop.render.rasterizer.sh import TERMS_OF_DEGREE

Backend = Literal["auto", "numba", "torch", "gsplat"]
BACKENDS: tuple[str, ...] = get_args(Backend)


def render(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Tensor | None = None,
    backend: Backend = "auto",
    near_m: float = NEAR_M,
) -> Rendering:
    """Render Gaussians from one camera, differentiably.

    Gradients flow from rgb, depth_m and alpha to means, quats, scales, opacities, sh and background.

    Args:
        gaussians: N Gaussians, world frame, N may be 0; quats of any length but zero.
        camera: The view.
        background: Colour behind everything, shape [3]; black when absent.
        backend: "numba" (CPU), "gsplat" (CUDA), "torch" (the slow reference), or "auto": gsplat for CUDA
            tensors, numba otherwise.
        near_m: Gaussians whose centre is closer than this are not drawn [m].

    Returns:
        The view, in the dtype of the means; "numba" and "gsplat" compute in float32.

    Raises:
        PlopError: A value is not finite, a shape is wrong, or the backend is not available.
    """
    return render_many(gaussians, [camera], background=background, backend=backend, near_m=near_m)[0]


def render_many(
    gaussians: Gaussians,
    cameras: list[Camera],
    *,
    background: Tensor | None = None,
    backend: Backend = "auto",
    near_m: float = NEAR_M,
) -> list[Rendering]:
    """Render the same Gaussians from several cameras; cheaper than one call each on "numba".

    Arguments, gradients and errors are those of `render`; one rendering per camera, in their order.
    """
    check_gaussians(gaussians)
    for camera in cameras:
        check_camera(camera)
    if not near_m > 0:
        raise PlopError("The near plane must be in front of the camera.", expected="near_m > 0", found=f"{near_m} m")
    background = _checked_background(background, gaussians.means)
    draw = _load(backend, gaussians.means)
    renderings: dict[int, Rendering] = {}
    for size in sorted({(camera.width, camera.height) for camera in cameras}):
        chosen = [i for i, camera in enumerate(cameras) if (camera.width, camera.height) == size]
        drawn = draw(gaussians, [cameras[i] for i in chosen], background, near_m)
        renderings.update(zip(chosen, drawn, strict=True))
    return [renderings[i] for i in range(len(cameras))]


def _load(backend: str, means: Tensor) -> Callable[[Gaussians, list[Camera], Tensor, float], list[Rendering]]:
    """Import the requested backend; it renders cameras of one size."""
    if backend == "auto":
        backend = "gsplat" if means.is_cuda else "numba"
    if backend == "torch":
        from plop.render.rasterizer.torch_backend import render_torch

        return render_torch
    if backend == "numba":
        from plop.render.rasterizer.numba_backend import render_numba

        return render_numba
    if backend == "gsplat":
        from plop.render.rasterizer.gsplat_backend import render_gsplat

        return render_gsplat
    raise PlopError("Unknown rendering backend.", expected=" or ".join(BACKENDS), found=str(backend))


def check_gaussians(gaussians: Gaussians) -> None:
    """Raise a PlopError that names the field with a wrong shape, NaN or infinity."""
    count = len(gaussians)
    tails = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": ()}
    for name, tail in tails.items():
        _check_shape(name, getattr(gaussians, name), (count, *tail))
    sh = gaussians.sh
    if sh.ndim != 3 or sh.shape[0] != count or sh.shape[1] not in TERMS_OF_DEGREE or sh.shape[2] != 3:
        raise PlopError(
            "The spherical harmonics have a wrong shape.",
            where="gaussians.sh",
            expected=f"[{count}, K, 3] with K = 1, 4, 9 or 16",
            found=str(list(sh.shape)),
        )
    fields = [getattr(gaussians, name).detach() for name in (*tails, "sh")]
    if count and not (fields[0].device.type == "cpu" and is_sound(*(array_of(field) for field in fields))):
        for name, values in zip((*tails, "sh"), fields, strict=True):
            _check_finite(name, values)
        _check_ranges(gaussians)


def check_camera(camera: Camera) -> None:
    """Raise a PlopError that names the camera with an invalid size, intrinsics or pose."""
    where = f"camera {camera.name}"
    if camera.width < 1 or camera.height < 1:
        raise PlopError("The camera has no pixels.", where=where, found=f"{camera.width} x {camera.height}")
    for name in ("intrinsics", "world_from_cam"):
        if not np.isfinite(getattr(camera, name)).all():
            raise PlopError(f"The camera's {name} contains NaN or infinity.", where=where)
    if camera.intrinsics[0, 0] <= 0 or camera.intrinsics[1, 1] <= 0:
        found = f"fx {camera.intrinsics[0, 0]:g}, fy {camera.intrinsics[1, 1]:g}"
        raise PlopError("The camera's focal length is not positive.", where=where, found=found)


def _check_shape(name: str, values: Tensor, shape: tuple[int, ...]) -> None:
    if tuple(values.shape) != shape:
        raise PlopError(
            f"The Gaussians' {name} have a wrong shape.",
            where=f"gaussians.{name}",
            expected=str(list(shape)),
            found=str(list(values.shape)),
        )


def _check_finite(name: str, values: Tensor) -> None:
    bad = ~torch.isfinite(values).reshape(values.shape[0], -1).all(dim=1)
    if bad.any():
        raise PlopError(
            f"The Gaussians' {name} contain NaN or infinity.",
            where=f"gaussians.{name}",
            expected="finite numbers",
            found=f"{int(bad.sum())} of {len(bad)} Gaussians, the first at index {int(bad.nonzero()[0])}",
            fix="Check their source for a diverged optimisation or a division by zero.",
        )


def _check_ranges(gaussians: Gaussians) -> None:
    opacities = gaussians.opacities.detach()
    low, high = float(opacities.min()), float(opacities.max())
    if low < OPACITY_LOW or high > OPACITY_HIGH:
        raise PlopError(
            "The Gaussians' opacities are out of range.",
            where="gaussians.opacities",
            expected="0 to 1",
            found=f"{low:g} to {high:g}",
            fix="Files contain logits; apply the sigmoid, as read_splat does.",
        )
    if not bool(gaussians.quats.any(dim=1).all()):
        raise PlopError("A Gaussian has no rotation.", where="gaussians.quats", found="a quaternion of four zeros")


def _checked_background(background: Tensor | None, like: Tensor) -> Tensor:
    if background is None:
        return like.new_zeros(3)
    if tuple(background.shape) != (3,) or not torch.isfinite(background.detach()).all():
        raise PlopError(
            "The background is not a colour.", expected="3 finite numbers", found=str(background.detach().tolist())
        )
    return background.to(like)
