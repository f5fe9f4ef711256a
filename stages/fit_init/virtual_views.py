"""Virtual views, rendered from the measured views: depth-image-based rendering.

A fit of a few views is wrong in other views: outlines extend beyond the object and colours of overlapping Gaussians
separate. However, the surface is known between the cameras, too: every measured pixel is a small flat patch of it,
with its colour.

Source: McMillan 1997, "An Image-Based Approach to Three-Dimensional Computer Graphics" (3D warping); colours are mixed
by how squarely a camera looks at the surface (Debevec, Taylor and Malik 1996, view-dependent texture mapping).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from plop.geometry.cameras import Camera, look_at
from plop.geometry.clouds.depth_planes import PixelPlanes, pixel_planes
from plop.geometry.rays import pixel_rays, window
from plop.geometry.view import MaskLabel, View
from plop.lazy_open3d import o3d
from stages.fit_init.shell import carved
from stages.fit_init.view_evidence import ViewEvidence

SIDE = 3
"""Rays along each side of a pixel."""
FACING_LEAST = 0.25
"""Cosine below which a camera looks along a surface rather than at it."""
_SAME_SHARE = 0.04
"""Difference in depth under which two views show the same point, as a share of the object's size."""
_LAYERS = 4
"""Largest number of surface patches tested along a ray."""
_SAMPLES = 32
"""Number of positions along a ray at which free space is tested."""
_STEEPEST_DEG = 80.0
"""Largest downward angle of virtual cameras."""


def virtual_views(views: Sequence[View], count: int) -> list[View]:
    """Render the object from positions spread evenly between the lowest and the highest of its cameras.

    Unmeasured pixels that may show the object are UNKNOWN. The tool is not rendered: views show the parts behind
    it that others have seen.

    Args:
        views: Measured views at one instant, at least two of them with depth; others add outlines only.
        count: Number of virtual views.

    Returns:
        `count` views, or none where fewer than two have measured pieces of surface.
    """
    if count < 1:
        return []
    planes = [pixel_planes(view.camera, view.depth_m, view.object_mask) for view in views]
    measured = [k for k, plane in enumerate(planes) if (plane.facing > FACING_LEAST).any()]
    if len(measured) < 2:
        return []
    drawn = _Drawn.of([views[k] for k in measured], [planes[k] for k in measured], views)
    return [drawn.view(camera) for camera in _cameras(drawn, [views[k] for k in measured], count)]


def _cameras(drawn: _Drawn, views: list[View], count: int) -> list[Camera]:
    """Place cameras on a spiral around the object, at the mean distance of the real ones."""
    middle = drawn.corners.mean(0)
    offsets = np.array([view.camera.world_from_cam[:3, 3] for view in views]) - middle
    distance = np.linalg.norm(offsets, axis=1)
    heights = np.clip(offsets[:, 2] / distance, *np.sin(np.radians([-_STEEPEST_DEG, _STEEPEST_DEG])))
    steps = (np.arange(count) + 0.5) / count
    up = heights.min() + (heights.max() - heights.min()) * steps
    turn = np.arange(count) * np.pi * (3 - 5**0.5)  # the golden angle: no two cameras above each other
    aside = np.sqrt(1 - up**2)
    toward = np.stack([np.cos(turn) * aside, np.sin(turn) * aside, up], axis=1)
    like = views[0].camera
    return [
        Camera(
            f"virtual_{k:02d}",
            like.width,
            like.height,
            like.intrinsics,
            look_at(middle + distance.mean() * direction, middle, np.array([0.0, 0.0, 1.0])),
        )
        for k, direction in enumerate(toward)
    ]


@dataclass(frozen=True)
class _Drawn:
    """The measured surface, prepared for rendering."""

    scene: o3d.t.geometry.RaycastingScene
    """One small square per measured pixel."""
    corners: np.ndarray
    """Corners of its bounding box, [2, 3] [m]."""
    pixel_m: float
    """Typical width of a pixel on it [m]."""
    sights: list[ViewEvidence]
    shrunk: list[View]
    """The views with outlines shrunk by a pixel: a ray within a pixel of the outline counts as free."""
    background: np.ndarray
    """Mean colour of the background, [3], 0..255."""

    @classmethod
    def of(cls, measured: list[View], planes: list[PixelPlanes], views: Sequence[View]) -> _Drawn:
        squares = np.concatenate([_squares(view.camera, plane) for view, plane in zip(measured, planes, strict=True)])
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        first = 4 * np.arange(len(squares))[:, None]
        faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]], axis=1).reshape(-1, 3)
        scene.add_triangles(
            o3d.core.Tensor.from_numpy(squares.reshape(-1, 3).astype(np.float32)),
            o3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
        )
        points = np.concatenate([plane.points[plane.facing > FACING_LEAST] for plane in planes])
        widths = [
            np.median(view.depth_m[view.object_mask & (view.depth_m > 0)]) / view.camera.intrinsics[0, 0]
            for view in measured
        ]
        behind = np.concatenate([view.rgb[view.mask == MaskLabel.BACKGROUND] for view in views])
        background = behind.mean(0) if len(behind) else np.full(3, 128.0)
        return cls(
            scene,
            np.stack([points.min(0), points.max(0)]),
            float(np.median(widths)),
            [ViewEvidence.of(view) for view in views],
            [_shrunk(view) for view in views],
            background,
        )

    @property
    def tolerance_m(self) -> float:
        """Difference in depth under which two views show the same point [m]."""
        return _SAME_SHARE * float(np.ptp(self.corners, axis=0).max())

    def view(self, camera: Camera) -> View:
        """Render one view."""
        box = np.stack(np.meshgrid(*self.corners.T, indexing="ij"), axis=-1).reshape(-1, 3)
        rows, columns = window(camera, box)
        rays = pixel_rays(camera, SIDE)[rows, columns]
        shape = rays.shape[:3]
        depth, colour = self._hits(rays.reshape(-1, 6).astype(np.float64))
        depth, colour = depth.reshape(shape), colour.reshape(*shape, 3)
        hit = np.isfinite(depth)
        middle = SIDE * SIDE // 2
        free = ~hit[..., middle]
        free[free] = self._free(rays[..., middle, :][free].astype(np.float64))
        # a ray without a hit is background, where the pixel or an adjacent one is known to be
        known = (hit | binary_dilation(free, np.ones((3, 3)))[..., None]).all(-1)
        part = np.where(hit[..., middle], MaskLabel.OBJECT, MaskLabel.BACKGROUND)
        mask = np.full((camera.height, camera.width), MaskLabel.BACKGROUND, np.uint8)
        mask[rows, columns] = np.where(known & (hit[..., middle] | free), part, MaskLabel.UNKNOWN)
        rgb = np.broadcast_to(self.background, (camera.height, camera.width, 3)).copy()
        rgb[rows, columns] = np.where(hit[..., None], colour, self.background).mean(2)
        metres = np.zeros(mask.shape, np.float32)
        metres[rows, columns] = np.where(hit[..., middle], depth[..., middle], 0)
        return View(camera, rgb.round().astype(np.uint8), metres, mask)

    def _hits(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth [N] (infinite where nothing is known to be hit) and colour [N, 3] along rays [N, 6]."""
        depth, colour = np.full(len(rays), np.inf), np.zeros((len(rays), 3))
        start, open_ = np.zeros(len(rays)), np.arange(len(rays))
        for _ in range(_LAYERS):
            origin = rays[open_, :3] + start[open_, None] * rays[open_, 3:]
            cast = np.concatenate([origin, rays[open_, 3:]], axis=1).astype(np.float32)
            hits = self.scene.cast_rays(o3d.core.Tensor.from_numpy(cast), nthreads=1)
            far = hits["t_hit"].numpy().astype(np.float64) + start[open_]
            normals = hits["primitive_normals"].numpy().astype(np.float64)
            front = np.isfinite(far) & ((normals * rays[open_, 3:]).sum(1) < 0)
            open_, far, normals = open_[front], far[front], normals[front]
            points = rays[open_, :3] + far[:, None] * rays[open_, 3:]
            wrong, mixed, weight = self._looked_at(points, normals)
            right = ~wrong & (weight > 0)
            depth[open_[right]] = far[right]
            colour[open_[right]] = mixed[right] / weight[right, None]
            start[open_] = far + 0.1 * self.pixel_m
            open_ = open_[wrong]
        return depth, colour

    def _looked_at(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate all views: whether one contradicts [N], weighted sum of colours [N, 3], sum of weights [N]."""
        wrong, mixed, total = np.zeros(len(points), bool), np.zeros((len(points), 3)), np.zeros(len(points))
        beyond_m, before_m = np.full(len(points), np.inf), np.full(len(points), np.inf)
        for sight in self.sights:
            said = sight.about(points, normals, self.tolerance_m)
            wrong |= said.wrong
            mixed += said.weight[:, None] * said.colour
            total += said.weight
            beyond_m, before_m = np.minimum(beyond_m, said.beyond_m), np.minimum(before_m, said.before_m)
        # Each camera's patch ends half a pixel beyond the object, plus or minus half a pixel: the largest one would
        # make every edge too wide. The edge is half way between the visible surface and free space.
        wrong |= np.isfinite(beyond_m) & (beyond_m > before_m)
        return wrong, mixed, total

    def _free(self, rays: np.ndarray) -> np.ndarray:
        """Return the rays [N, 6] that miss the object, because views see through or past every position on them."""
        with np.errstate(divide="ignore"):
            ends = (self.corners[:, None] - rays[:, :3]) / rays[:, 3:]
        near, far = ends.min(0).max(1), ends.max(0).min(1)
        free = near >= far  # misses the bounding box of all measurements
        inside = np.flatnonzero(~free)
        along = near[inside, None] + (far - near)[inside, None] * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        points = rays[inside, None, :3] + along[..., None] * rays[inside, None, 3:]
        empty = carved(points.reshape(-1, 3), self.shrunk, -self.pixel_m)
        free[inside] = empty.reshape(along.shape).all(1)
        return free


def _squares(camera: Camera, planes: PixelPlanes) -> np.ndarray:
    """Corners of each pixel's surface patch, counter-clockwise seen from the camera, [N, 4, 3] [m]."""
    rows, columns = np.nonzero(planes.facing > FACING_LEAST)
    points, normals = planes.points[rows, columns], planes.normals[rows, columns]
    eye, rotation = camera.world_from_cam[:3, 3], camera.world_from_cam[:3, :3]
    corners = []
    for right, down in ((0, 0), (0, 1), (1, 1), (1, 0)):
        directions = camera.directions(columns + right, rows + down) @ rotation.T
        depth = ((points - eye) * normals).sum(1) / (directions * normals).sum(1)
        corners.append(eye + depth[:, None] * directions)
    return np.stack(corners, axis=1)


def _shrunk(view: View) -> View:
    """Shrink the object's mask by a pixel where it borders on the background."""
    kept = binary_erosion(view.mask != MaskLabel.BACKGROUND, np.ones((3, 3)), border_value=1)
    return replace(view, mask=np.where(kept, view.mask, MaskLabel.BACKGROUND).astype(np.uint8))
