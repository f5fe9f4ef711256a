"""Object masks for real pictures: workspace box, table plane and tool removal, refined by a colour model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import open3d as o3d
from PIL import Image
from scipy.spatial import cKDTree

from plop.causes import Cause, Noticed
from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.recordings.recording import MaskLabel, Mesh
from plop.recordings.side_pictures import find_side_pictures
from stages.ingest.depth_points import world_points


@dataclass(frozen=True)
class MaskRules:
    """How object masks are made."""

    table_clear_m: float = 0.006
    """Points lower than this above the table belong to the table [m]."""
    tool_margin_m: float = 0.008
    """Measured points this near to the tool's surface along the ray are the tool's [m]."""
    tool_margin_px: int = 2
    """Pixels around the tool's silhouette that are undecided when they are as near as the tool [px]."""
    hand_radius_m: float = 0.06
    """Radius of the capsule around hand and wrist whose pixels are undecided [m]; 0 = off."""
    hand_from_m: float = -0.12
    """Start of that capsule along the flange's z axis [m]."""
    hand_to_m: float = 0.10
    """End of that capsule along the flange's z axis [m]."""
    refine_px: int = 3
    """Half width of the band along the outline that the colour model decides [px]; 0 = geometry only."""
    refine_rounds: int = 2
    """Iterations of the graph cut."""
    min_area_px: int = 12
    """Smaller pieces of the object's mask are dropped [px]."""


@dataclass(frozen=True)
class Picture:
    """What a mask is made from."""

    camera: Camera
    rgb: np.ndarray
    """[H, W, 3] uint8"""
    depth_m: np.ndarray
    """[H, W] float32, 0 = not measured"""
    world_from_tool: np.ndarray
    """[4, 4]"""
    world_from_flange: np.ndarray | None = None
    """[4, 4]; None leaves the hand in"""
    episode: str = ""
    frame: int = 0
    """Frame number of the video."""


class Masker(Protocol):
    """Makes the mask of one picture."""

    def mask(self, picture: Picture) -> np.ndarray:
        """Give MaskLabel per pixel, [H, W] uint8."""
        ...


class GeometricMasker:
    """Mask what is inside the workspace, above the table and neither tool nor hand.

    Args:
        workspace: Lowest and highest corner, shape [2, 3], world [m].
        table_z_m: Height of the table [m].
        tool: The tool in its own frame.
        rules: Distances and widths.
    """

    def __init__(self, workspace: np.ndarray, table_z_m: float, tool: Mesh, rules: MaskRules) -> None:
        self.workspace, self.table_z_m, self.rules = workspace, table_z_m, rules
        self._tool = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._tool.add_triangles(o3d.core.Tensor.from_numpy(tool.vertices.astype(np.float32)),
                                 o3d.core.Tensor.from_numpy(tool.faces.astype(np.uint32)))  # fmt: skip

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
        """Give the pixels that show the tool, and undecided pixels along its silhouette; bool, [H, W] each."""
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
        """Take back pixels that colour added but whose depth shows the table beside the object, not its foot."""
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


class FolderMasker:
    """Take masks made elsewhere: `<folder>/<episode>/<serial>/<frame>.png`, values as in MaskLabel.

    Args:
        folder: The folder of masks.
        frames: Frames of the video of each (episode, camera).
        binary: Any value but 0 is the object; the tool is then found by its mesh.
        geometric: Finds the tool for binary masks.
    """

    def __init__(
        self, folder: Path, frames: Mapping[tuple[str, str], int], *, binary: bool, geometric: GeometricMasker
    ) -> None:
        self.folder, self.binary, self.geometric = folder, binary, geometric
        self.pictures = {key: find_side_pictures(folder.joinpath(*key), count, what="masks", cause=Cause.MASKS)
                         for key, count in frames.items()}  # fmt: skip

    def warnings(self) -> list[Noticed]:
        """Say what was assumed about the numbers."""
        return [Noticed(note, Cause.MASKS, "Check the numbers of the masks.")
                for pictures in self.pictures.values() for note in pictures.notes]  # fmt: skip

    def mask(self, picture: Picture) -> np.ndarray:
        """See Masker.

        Raises:
            PlopError: There is no mask for this frame, or its values are no labels.
        """
        pictures = self.pictures[picture.episode, picture.camera.name]
        path = pictures.paths.get(picture.frame)
        if path is None:
            raise PlopError("A frame has no mask.", where=f"{pictures.folder}: frame {picture.frame}",
                            expected=f"{picture.frame:06d}.png", found=f"no such picture; {pictures.range_text()}",
                            fix="Write one mask per frame of the video, counted from 0.", cause=Cause.MASKS)  # fmt: skip
        values = _mask_values(path)
        height, width = picture.depth_m.shape
        values = cv2.resize(values, (width, height), interpolation=cv2.INTER_NEAREST)
        if not self.binary:
            return _checked_labels(values, path)
        tool, _ = self.geometric.tool_pixels(picture)
        out = np.where(values > 0, MaskLabel.OBJECT, MaskLabel.BACKGROUND).astype(np.uint8)
        out[tool & (values == 0)] = MaskLabel.TOOL
        return out


def _mask_values(path: Path) -> np.ndarray:
    """Read a mask's values as stored, uint8, [H, W]: of a palette picture the indices, never the colours."""
    try:
        with Image.open(path) as picture:
            mode, values = picture.mode, np.asarray(picture)
    except (OSError, ValueError, SyntaxError) as error:
        raise PlopError("A mask cannot be read.", where=path, expected="an 8-bit PNG of one channel",
                        found=str(error), fix="Write the masks again.", cause=Cause.MASKS) from error  # fmt: skip
    if mode == "1":
        return values.astype(np.uint8)
    if values.dtype != np.uint8 or (values.ndim == 3 and not (values[..., :1] == values[..., :3]).all()):
        raise PlopError("A mask cannot be used.", where=path, expected="an 8-bit PNG of one channel, or with a palette",
                        found=f"{values.dtype}, {values.shape} ({mode})",
                        fix="Write labels, not colours: 0 background, 1 object, 2 tool, 255 undecided.",
                        cause=Cause.MASKS)  # fmt: skip
    return values if values.ndim == 2 else np.ascontiguousarray(values[..., 0])


def _checked_labels(values: np.ndarray, path: Path) -> np.ndarray:
    present = set(np.unique(values).tolist())
    strange = present - {int(label) for label in MaskLabel}
    if strange or present == {0, 255}:
        two = len(present) == 2 and 0 in present
        raise PlopError("A mask has other values than labels.", where=path,
                        expected="0 background, 1 object, 2 tool, 255 undecided",
                        found=f"the values {sorted(present)[:8]}" + (": two values, so object or not" if two else ""),
                        fix="Use --binary-masks: any value but 0 means the object." if two else
                        "Relabel it, or use --binary-masks if any value but 0 means the object.",
                        cause=Cause.MASKS)  # fmt: skip
    return values


def refine(
    rgb: np.ndarray, solid: np.ndarray, outside: np.ndarray, measured: np.ndarray, band_px: int, rounds: int
) -> np.ndarray:
    """Let colour decide along the outline and where depth is missing (GrabCut: mixture models and a graph cut).

    Args:
        rgb: [H, W, 3] uint8.
        solid: The object by geometry, bool, [H, W].
        outside: Pixels that are surely not the object, bool, [H, W].
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
    cv2.grabCut(picture, part, None, *models, rounds, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    out = np.zeros_like(solid)
    out[box] = (part == cv2.GC_FGD) | (part == cv2.GC_PR_FGD)
    return out


def drop_small(mask: np.ndarray, min_area_px: int) -> np.ndarray:
    """Drop connected pieces of a bool mask that are smaller than `min_area_px`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= min_area_px
    large[0] = False
    return large[labels]
