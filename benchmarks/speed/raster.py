"""Speed of the rasterizer: forward and backward of one view of a soft object of 100 mm, seen from 0.36 m."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchmarks.speed.measure import median_ms

if TYPE_CHECKING:
    from plop.gaussians.state import Gaussians
    from plop.geometry.cameras import Camera
    from plop.render.rasterizer.rasterize import Backend


OPERATIONS_PER_REGISTER = 19 + 30
"""Products and multiply-adds of sixteen pixels, forward and backward; other operations have units of their own."""


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {
        "raster_128_5k_fwd_bwd_ms": lambda: raster_ms(5_000, 128),
        "raster_256_20k_fwd_bwd_ms": lambda: raster_ms(20_000, 256),
        "raster_128_3k_6_views_fwd_bwd_ms": lambda: raster_ms(3_000, 128, views=6),
        "raster_128_5k_speedup_over_torch": speedup_over_torch,
        "raster_blending_floor_ms": lambda: blending_floor_ms(5_000, 128),
    }


def raster_ms(count: int, size_px: int, *, backend: Backend = "numba", views: int = 1, repeats: int = 41) -> float:
    """Measure the median time of one forward and backward pass [ms]."""
    import torch

    from plop.render.rasterizer.rasterize import render_many

    gaussians, cameras = scene(count), [camera(size_px, azimuth) for azimuth in range(views)]
    fields = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh]
    generator = torch.Generator().manual_seed(1)
    shapes = [(size_px, size_px, 3), (size_px, size_px), (size_px, size_px)] * views
    upstream = [torch.rand(*shape, generator=generator) for shape in shapes]

    def pass_() -> None:
        for field in fields:
            field.grad = None
        images = render_many(gaussians, cameras, backend=backend)
        outputs = [part for image in images for part in (image.rgb, image.depth_m, image.alpha)]
        torch.autograd.backward(outputs, upstream)

    return median_ms(pass_, repeats=repeats, warm_up=0 if backend == "torch" else 2)


def speedup_over_torch() -> float:
    """Compare with the plain-torch reference on the same scene, in one run."""
    return raster_ms(5_000, 128, backend="torch", repeats=1) / raster_ms(5_000, 128)


def blending_floor_ms(count: int, size_px: int) -> float:
    """Return how long two cores would blend, forward and backward, at their peak of multiply-adds [ms].

    Counted are sixteen pixels for every two rows of a tile that a splat reaches before the tile is finished.
    """
    import numpy as np

    from plop.render.rasterizer import numba_backend, numba_bins, numba_blend

    gaussians, view = scene(count), numba_backend.pack_view(camera(size_px, 0), 0.01)
    names = ("means", "quats", "scales", "opacities", "sh")
    arrays = [getattr(gaussians, name).detach().numpy() for name in names]
    lists = numba_backend._list_splats(arrays, view[None], size_px, size_px)
    shape, kind = (1, size_px, size_px), np.float32
    images = [np.empty((*shape, 3), kind), *(np.empty(shape, kind) for _ in range(4))]
    tiles = (lists.tile_starts, lists.tile_counts, lists.by_tile, lists.tiles_x)
    numba_blend.blend_forward(0, 1, lists.splats, lists.boxes, *tiles, *images)
    registers = 0
    for tile, (start, _) in enumerate(zip(lists.tile_starts[0], lists.tile_counts[0], strict=True)):
        x, y = (tile % lists.tiles_x * numba_bins.TILE_WIDTH, tile // lists.tiles_x * numba_bins.TILE_HEIGHT)
        end = images[-1][0, y : y + numba_bins.TILE_HEIGHT, x : x + numba_bins.TILE_WIDTH].max()
        boxes = lists.boxes[0, lists.by_tile[start : start + int(end)]]
        rows = np.minimum(boxes[:, 3] - y, numba_bins.TILE_HEIGHT) - np.maximum(boxes[:, 2] - y, 0)
        registers += int(((rows + 1) // 2).sum())
    return registers * OPERATIONS_PER_REGISTER / (2 * _operations_per_ms())


def _operations_per_ms() -> float:
    """Measure the multiply-adds of sixteen float32 that one core does in a millisecond."""
    import numpy as np
    from numba import njit

    from plop.compute.numba_lanes import load, spread, store

    @njit(fastmath={"contract"}, nogil=True)  # type: ignore[untyped-decorator]
    def chains(times, s):  # type: ignore[no-untyped-def]
        m, c = spread(np.float32(0.4)), spread(np.float32(0.001))
        v0, v1, v2, v3, v4, v5, v6, v7 = m, c, m + c, c + c, m + m, m - c, c - m, m * c  # all below 1
        for _ in range(times):
            v0, v1, v2, v3 = v0 * v0 + c, v1 * v1 + c, v2 * v2 + c, v3 * v3 + c
            v4, v5, v6, v7 = v4 * v4 + c, v5 * v5 + c, v6 * v6 + c, v7 * v7 + c
        store(s, 0, load(s, 0) + v0 + v1 + v2 + v3 + v4 + v5 + v6 + v7)

    s = np.zeros(16, np.float32)
    return 8 * 100_000 / min(median_ms(lambda: chains(100_000, s), repeats=5) for _ in range(5))


def scene(count: int) -> Gaussians:
    """Fill a box of 100 x 100 x 60 mm with Gaussians of 1.5 to 3 mm; every field requires a gradient."""
    import torch

    from plop.gaussians.state import Gaussians

    generator = torch.Generator().manual_seed(0)

    def uniform(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator)

    fields = {
        "means": (uniform(count, 3) - 0.5) * torch.tensor([0.1, 0.1, 0.06]),
        "quats": torch.randn(count, 4, generator=generator),
        "scales": 0.0015 + 0.0015 * uniform(count, 3),
        "opacities": 0.05 + 0.9 * uniform(count),
        "sh": 0.4 * torch.randn(count, 1, 3, generator=generator),
    }
    return Gaussians(**{name: field.requires_grad_() for name, field in fields.items()}, ids=torch.arange(count))


def camera(size_px: int, azimuth: int) -> Camera:
    """Look at the box from 0.36 m, turned by 60 degrees per step; one pixel is 1.6 mm there at 128 px."""
    import numpy as np

    from plop.geometry.cameras import Camera, look_at

    focal, angle = size_px * 225 / 128, np.deg2rad(60 * azimuth)
    intrinsics = np.array([[focal, 0, size_px / 2], [0, focal, size_px / 2], [0, 0, 1]])
    eye = np.array([0.3 * np.sin(angle), -0.3 * np.cos(angle), 0.2])
    return Camera(f"view {azimuth}", size_px, size_px, intrinsics, look_at(eye, np.zeros(3), np.array([0.0, 0.0, 1.0])))
