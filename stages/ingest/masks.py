"""Object masks for real images: workspace box, table plane and tool removal, refined by a colour model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Protocol

import cv2
import numpy as np
from scipy.spatial import cKDTree

from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel
from plop.lazy_open3d import o3d
from plop.recordings.recording import Mesh
from plop.setting_kinds import Range, Settings, Unit
from stages.ingest.depth_points import world_points


@dataclass(frozen=True)
class MaskRules(Settings):
    """How object masks are made; the defaults are defined only here."""

    table_clear_m: Annotated[float, Range(0, 0.5), Unit("m")] = 0.006
    """Height above the table below which points belong to it."""
    tool_margin_m: Annotated[float, Range(0, 0.5), Unit("m")] = 0.008
    """Largest distance along the ray between measured points of the tool and its surface."""
    tool_margin_px: Annotated[int, Range(0, 100), Unit("px")] = 2
    """Width of the band around the tool's silhouette that is undecided where its depth is that of the tool."""
    hand_radius_m: Annotated[float, Range(0, 1), Unit("m")] = 0.06
    """Radius of the capsule around hand and wrist whose pixels are undecided; 0 = off."""
    hand_from_m: Annotated[float, Range(-2, 2), Unit("m")] = -0.12
    """Start of that capsule along the flange's z axis."""
    hand_to_m: Annotated[float, Range(-2, 2), Unit("m")] = 0.10
    """End of that capsule along the flange's z axis."""
    refine_px: Annotated[int, Range(0, 100), Unit("px")] = 3
    """Half width of the band along the outline that is segmented by the colour model; 0 = geometry only."""
    refine_rounds: Annotated[int, Range(0, 100)] = 2
    """Iterations of the graph cut."""
    min_area_px: Annotated[int, Range(0, 1e6), Unit("px")] = 12
    """Smallest connected part of the object's mask; smaller ones are discarded."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_order("The end of the hand's capsule is before its start.", "hand_from_m", "hand_to_m", "mask.")


@dataclass(frozen=True)
class Picture:
    """Input of a mask."""

    camera: Camera
    rgb: np.ndarray
    """[H, W, 3] uint8"""
    depth_m: np.ndarray
    """[H, W] float32, 0 = not measured"""
    world_from_tool: np.ndarray
    """[4, 4]"""
    world_from_flange: np.ndarray | None = None
    """[4, 4]; None keeps the hand"""
    episode: str = ""
    frame: int = 0
    """Frame number of the video."""


class Masker(Protocol):
    """Makes the mask of one image."""

    def mask(self, picture: Picture) -> np.ndarray:
        """Return MaskLabel per pixel, [H, W] uint8."""
        ...


class GeometricMasker:
    """Mask the part inside the workspace, above the table, that is neither tool nor hand.

    Args:
        workspace: Lowest and highest corner, shape [2, 3], world [m].
        table_z_m: Height of the table [m].
        tool: The tool in its own frame.
        rules: Distances and widths.
    """

    def __init__(self, workspace: np.ndarray, table_z_m: float, tool: Mesh, rules: MaskRules) -> None:
        self.workspace, self.table_z_m, self.rules = workspace, table_z_m, rules
        self._tool = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._tool.add_triangles(
            o3d.core.Tensor.from_numpy(tool.vertices.astype(np.float32)),
            o3d.core.Tensor.from_numpy(tool.faces.astype(np.uint32)),
        )

    def mask(self, picture: Picture) -> np.ndarray:
        """See Masker."""
        rules, depth = self.rules, picture.depth_m
        measured = np.isfinite(depth) & (depth > 0)
        tool, near_tool = self.tool_pixels(picture)
        points = world_points(picture.camera, depth)
        in_box = measured & (points >= self.workspace[0]).all(-1) & (points <= self.workspace[1]).all(-1)
        hand = measured & self._near_hand(points, picture.world_from_flange) & ~tool
        solid = in_box & (points[..., 2] > self.table_z_m + rules.table_clear_m) & ~tool & ~near_tool & ~hand
        solid = drop_small(solid, rules.min_area_px)
        if rules.refine_px and solid.any():
            outside = (measured & ~in_box) | tool
            refined = refine(picture.rgb, solid, outside, measured, rules.refine_px, rules.refine_rounds) & ~hand
            solid = drop_small(self._without_table(refined, solid, measured, points, picture), rules.min_area_px)
        out = np.full(depth.shape, MaskLabel.BACKGROUND, np.uint8)
        out[hand | (near_tool & ~solid)] = MaskLabel.UNKNOWN
        out[solid] = MaskLabel.OBJECT
        out[tool] = MaskLabel.TOOL
        return out

    def tool_pixels(self, picture: Picture) -> tuple[np.ndarray, np.ndarray]:
        """Return the pixels that show the tool, and undecided pixels along its silhouette; bool, [H, W] each."""
        camera, depth = picture.camera, picture.depth_m
        expected = self._tool_depth(camera, picture.world_from_tool)
        unmeasured = ~(np.isfinite(depth) & (depth > 0))
        hit = expected > 0
        tool = hit & (unmeasured | (depth > expected - self.rules.tool_margin_m))
        width = 2 * self.rules.tool_margin_px + 1
        nearest = cv2.erode(np.where(hit, expected, np.float32(1e6)), np.ones((width, width), np.uint8))
        near = ~hit & ~unmeasured & (np.abs(depth - nearest) < self.rules.tool_margin_m)
        return tool, near

    def _without_table(
        self, refined: np.ndarray, solid: np.ndarray, measured: np.ndarray, points: np.ndarray, picture: Picture
    ) -> np.ndarray:
        """Remove pixels added by colour whose depth shows the table beside the object."""
        rows, columns = np.nonzero(refined & ~solid & measured)
        if not len(rows):
            return refined
        footprint = picture.depth_m[rows, columns] / picture.camera.intrinsics[0, 0]
        beside, _ = cKDTree(points[solid][:, :2]).query(points[rows, columns, :2])
        wrong = beside > self.rules.table_clear_m / 2 + footprint
        out = refined.copy()
        out[rows[wrong], columns[wrong]] = False
        return out

    def _tool_depth(self, camera: Camera, world_from_tool: np.ndarray) -> np.ndarray:
        """Cast a ray through every pixel centre; depth of the tool along the optical axis, 0 = no hit."""
        cam_from_tool = camera.cam_from_world @ world_from_tool
        rotation, shift = cam_from_tool[:3, :3], cam_from_tool[:3, 3]
        rays = camera.pixel_directions()
        origin = np.broadcast_to(-rotation.T @ shift, rays.shape)
        packed = np.concatenate([origin, rays @ rotation], axis=-1).astype(np.float32)
        hits = self._tool.cast_rays(o3d.core.Tensor.from_numpy(packed), nthreads=1)["t_hit"].numpy()
        return np.where(np.isfinite(hits), hits, 0).astype(np.float32)

    def _near_hand(self, points: np.ndarray, world_from_flange: np.ndarray | None) -> np.ndarray:
        rules = self.rules
        if world_from_flange is None or rules.hand_radius_m <= 0:
            return np.zeros(points.shape[:-1], bool)
        local = (points - world_from_flange[:3, 3]) @ world_from_flange[:3, :3]
        along = np.clip(local[..., 2], rules.hand_from_m, rules.hand_to_m)
        local[..., 2] -= along
        return (local**2).sum(-1) < rules.hand_radius_m**2


def refine(
    rgb: np.ndarray, solid: np.ndarray, outside: np.ndarray, measured: np.ndarray, band_px: int, rounds: int
) -> np.ndarray:
    """Segment by colour along the outline and where depth is missing (GrabCut: mixture models and a graph cut).

    Args:
        rgb: [H, W, 3] uint8.
        solid: The object by geometry, bool, [H, W].
        outside: Pixels that are certainly not the object, bool, [H, W].
        measured: Pixels with depth, bool, [H, W].
        band_px: Half width of the undecided band [px].
        rounds: Iterations.

    Returns:
        The object, bool, [H, W].
    """
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band_px + 1,) * 2)
    closed = cv2.morphologyEx(solid.astype(np.uint8), cv2.MORPH_CLOSE, disc).astype(bool)
    solid = solid | (closed & ~measured & ~outside)
    wide = cv2.dilate(solid.astype(np.uint8), disc).astype(bool)
    core = cv2.erode(solid.astype(np.uint8), disc, borderValue=1).astype(bool)
    state = np.full(solid.shape, cv2.GC_BGD, np.uint8)
    state[wide & ~outside] = cv2.GC_PR_BGD
    state[solid] = cv2.GC_PR_FGD
    state[core if core.any() else solid] = cv2.GC_FGD
    rows, columns = np.flatnonzero(wide.any(1)), np.flatnonzero(wide.any(0))
    margin = 4 * band_px
    box = tuple(slice(max(0, line[0] - margin), line[-1] + margin + 1) for line in (rows, columns))
    part = np.ascontiguousarray(state[box])
    if not (part == cv2.GC_BGD).any():
        return solid
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    picture = cv2.cvtColor(np.ascontiguousarray(rgb[box]), cv2.COLOR_RGB2BGR)
    cv2.grabCut(picture, part, None, *models, rounds, cv2.GC_INIT_WITH_MASK)
    out = np.zeros_like(solid)
    out[box] = (part == cv2.GC_FGD) | (part == cv2.GC_PR_FGD)
    return out


def drop_small(mask: np.ndarray, min_area_px: int) -> np.ndarray:
    """Discard connected parts of a bool mask that are smaller than `min_area_px`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= min_area_px
    large[0] = False
    return large[labels]
