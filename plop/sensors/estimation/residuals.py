"""What table and tool should look like through a camera with given faults, against what it recorded.

Three kinds of residuals, none of which knows of the object: depth on the table, depth on the tool, and the tool's
outline (its mask against the share of each pixel that the drawn tool covers, both blurred alike). Each comes with
its derivatives by all parameters. For a camera moved by (v, w) in its own axes a point X of the scene moves by
-v + X x w in the camera; a surface with normal n met by the ray r (r_z = 1) changes its depth by n.dX / n.r; an
image c whose content moves by dp changes by -grad c . dp (optical flow constraint, Horn and Schunck 1981).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from plop.geometry.cameras import Camera
from plop.geometry.rigid import invert_rigid, transform_points
from plop.geometry.view import MaskLabel
from plop.lazy_open3d import o3d
from plop.sensors.estimation.camera_frames import CameraScene, Sighting, ToolTrack
from plop.sensors.estimation.parameters import ABSENT, SLICES, TOTAL
from plop.sensors.faults.pose_error import moved_pose
from plop.sensors.silhouette import coverage

MOST_PIXELS = 250
"""Pixels of one kind used in one frame; of more, some are drawn."""
NEAR_REACHES, NEAR_LEAST_M = 3.0, 0.15
"""Table is looked at this near to the object: in half diagonals of it, and at least [m]."""
GRAZING = 0.25
"""Surfaces whose normal makes a smaller cosine with the ray are left out."""
GATE = 0.12
"""Depth that differs by a larger share is of something else."""
ABOVE_TABLE_M = 0.004
"""The tool is looked at this far above the table, which hides what is below it [m]."""
PIXEL_ERROR = 1 / np.sqrt(12)
"""Standard deviation of what a pixel rounds, uniform over its width [px]: masks say of each pixel whether its centre is
covered. Outlines are not trusted beyond it in what their pixels have in common: shifted right, shifted down, grown,
each alike everywhere or by a slope across the picture, so that neither place nor turn of an edge is believed."""
SYSTEMATIC_M = 5e-5
"""Depth is not trusted beyond this in what all pixels have in common: an offset, a slope right, a slope down. Without
it thousands of pixels free of noise tell one mixture of pose and depth scale to a micrometre, another one in each
episode, and where these cross, far away, several episodes together would see a fault that none of them sees [m]."""


@dataclass(frozen=True)
class Rows:
    """Residuals (recorded minus expected) and the derivatives of what is expected."""

    residual: np.ndarray
    """[N], metres or share of a pixel"""
    jacobian: np.ndarray
    """[N, 19]: by what may be wrong with the camera, then with the tool."""
    patterns: np.ndarray
    """[N, PATTERNS]: what is systematically off, by SYSTEMATIC_M or PIXEL_ERROR: depth, then outlines to the right,
    down, and outwards; each by an offset, a slope right and a slope down."""


PATTERNS = 12
NONE = Rows(np.zeros(0), np.zeros((0, TOTAL)), np.zeros((0, PATTERNS)))


@dataclass(frozen=True)
class _Setting:
    """One frame under one hypothesis."""

    sighting: Sighting
    camera: Camera
    factor: float
    offset_m: float
    world_from_tool: np.ndarray | None
    cam_tool_rate: np.ndarray
    """Derivative of cam_from_tool by the clock offset, shape [4, 4] [1/s]."""

    def move(self, points: np.ndarray, on_tool: bool) -> np.ndarray:
        """Give how points in the camera [N, 3] move by each parameter of time and pose, shape [N, 3, 19]."""
        out = np.zeros((len(points), 3, TOTAL))
        zero = np.zeros(len(points))
        x, y, z = points.T
        turn = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
        six = np.concatenate([np.tile(-np.eye(3), (len(points), 1, 1)), turn], -1)
        out[:, :, SLICES["pose_error"]] = six
        out[:, :, SLICES["pose_drift"]] = self.sighting.share * six
        if on_tool and self.world_from_tool is not None:
            local = transform_points(invert_rigid(self.world_from_tool) @ self.camera.world_from_cam, points)
            out[:, :, SLICES["clock"].start] = transform_points(self.cam_tool_rate, local)
            out[:, :, SLICES["tool_offset"]] = self.camera.cam_from_world[:3, :3] @ self.world_from_tool[:3, :3]
        return out

    def depth_rows(
        self, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray, normals: np.ndarray, on_tool: bool
    ) -> Rows:
        """Compare depth at pixels [N] with expected true depth [N] of a surface with normals [N, 3] in the camera."""
        recorded = self.sighting.view.depth_m[rows, columns].astype(np.float64)
        across = _across(self.camera, rows, columns)
        rays = self.camera.directions(columns + 0.5, rows + 0.5)
        facing = (normals * rays).sum(1)
        keep = (np.abs(facing) > GRAZING * np.linalg.norm(rays, axis=1)) & (depth > 0) & (recorded > 0)
        keep &= np.abs(recorded - depth) < GATE * depth
        recorded, depth, rays, normals, facing, across = (
            a[keep] for a in (recorded, depth, rays, normals, facing, across)
        )
        moved = self.move(rays * depth[:, None], on_tool)
        jacobian = self.factor * np.einsum("nk,nkp->np", normals / facing[:, None], moved)
        jacobian[:, SLICES["depth_scale"].start] = depth
        jacobian[:, SLICES["depth_bias"].start] = 1.0
        jacobian[:, SLICES["tool_thickness"].start] = -self.factor * on_tool / np.abs(facing)
        patterns = np.zeros((len(depth), PATTERNS))
        patterns[:, :3] = SYSTEMATIC_M * across
        return Rows(recorded - self.factor * depth - self.offset_m, jacobian, patterns)


def residuals(scene: CameraScene, sighting: Sighting, deviation: np.ndarray, blur_px: float) -> dict[str, Rows]:
    """Give all residuals of one frame: "table" [m], "tool" [m], "outline" [share of a pixel].

    Args:
        scene: The camera.
        sighting: The frame.
        deviation: Parameters as deviations from 'absent', shape [15].
        blur_px: Standard deviation of the blur of the outline [px].
    """
    setting = _setting(scene, sighting, deviation)
    out = {"table": NONE if scene.table_z_m is None else _table(scene, setting), "tool": NONE, "outline": NONE}
    if scene.tool is not None:
        out["tool"], out["outline"] = _tool(scene, scene.tool, setting, blur_px)
    return out


def _setting(scene: CameraScene, sighting: Sighting, deviation: np.ndarray) -> _Setting:
    values = ABSENT + deviation
    recorded = sighting.view.camera
    pose = moved_pose(recorded.world_from_cam, values[SLICES["pose_error"]])
    camera = replace(recorded, world_from_cam=moved_pose(pose, sighting.share * values[SLICES["pose_drift"]]))
    factor, offset = float(values[SLICES["depth_scale"].start]), float(values[SLICES["depth_bias"].start])
    if scene.tool is None:
        return _Setting(sighting, camera, factor, offset, None, np.zeros((4, 4)))
    when = sighting.time_s - float(values[SLICES["clock"].start])
    time = scene.tool.time_s
    half = 0.25 * float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    before, now, after = scene.tool.at(when + half * np.array([-1, 0, 1]))
    # The difference of two poses has no homogeneous 1, so that cam_from_world only turns it.
    rate = camera.cam_from_world @ ((before - after) / (2 * half))
    return _Setting(sighting, camera, factor, offset, now, rate)


def _table(scene: CameraScene, setting: _Setting) -> Rows:
    view, camera = setting.sighting.view, setting.camera
    clear = cv2.erode((view.mask == MaskLabel.BACKGROUND).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    rows, columns = np.nonzero(clear & (view.depth_m > 0))
    rays = camera.directions(columns + 0.5, rows + 0.5)
    rotation, eye = camera.world_from_cam[:3, :3], camera.world_from_cam[:3, 3]
    down = rays @ rotation[2]
    depth = (float(scene.table_z_m or 0.0) - eye[2]) / np.where(np.abs(down) < 1e-6, np.nan, down)
    aside = np.linalg.norm((eye + (rays @ rotation.T) * depth[:, None] - scene.middle)[:, :2], axis=1)
    near = np.flatnonzero(aside < max(NEAR_REACHES * scene.reach_m, NEAR_LEAST_M))
    near = near[_few(camera, rows[near], columns[near])]
    normals = np.tile(rotation[2], (len(near), 1))
    return setting.depth_rows(rows[near], columns[near], depth[near], normals, on_tool=False)


def _tool(scene: CameraScene, tool: ToolTrack, setting: _Setting, blur_px: float) -> tuple[Rows, Rows]:
    assert setting.world_from_tool is not None
    view, camera = setting.sighting.view, setting.camera
    drawn = coverage(tool.mesh, setting.world_from_tool, camera)
    if not drawn.any():
        return NONE, NONE
    rows, columns = np.nonzero(cv2.dilate(drawn, np.ones((3, 3))) > 0)
    depth, normals = _cast(tool, setting, rows, columns)
    image = np.zeros(drawn.shape, np.float32)
    image[rows, columns] = depth
    floor = -np.inf if scene.table_z_m is None else scene.table_z_m + ABOVE_TABLE_M
    inside = cv2.erode(((drawn > 0.99) & view.tool_mask).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    use = inside[rows, columns] & (depth > 0)
    use[use] = _heights(camera, rows[use], columns[use], depth[use]) > floor
    chosen = np.flatnonzero(use)
    chosen = chosen[_few(camera, rows[chosen], columns[chosen])]
    surface = setting.depth_rows(rows[chosen], columns[chosen], depth[chosen], normals[chosen], on_tool=True)
    outline = _outline(setting, drawn, image, floor, blur_px)
    # Of a blade seen edge-on, a line between pixels is left, and no face.
    return surface, outline if len(surface.residual) >= len(outline.residual) else NONE


def _cast(tool: ToolTrack, setting: _Setting, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth [N] (0 where the ray misses) and normals in the camera [N, 3] of the tool at pixels."""
    assert setting.world_from_tool is not None
    tool_from_cam = invert_rigid(setting.world_from_tool) @ setting.camera.world_from_cam
    rays = np.empty((len(rows), 6), np.float32)
    rays[:, :3] = tool_from_cam[:3, 3]
    rays[:, 3:] = setting.camera.directions(columns + 0.5, rows + 0.5) @ tool_from_cam[:3, :3].T
    hits = tool.caster.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)
    depth = hits["t_hit"].numpy().astype(np.float64)
    return np.where(np.isfinite(depth), depth, 0), hits["primitive_normals"].numpy() @ tool_from_cam[:3, :3]


def _outline(setting: _Setting, drawn: np.ndarray, depth: np.ndarray, floor_m: float, blur_px: float) -> Rows:
    view, camera = setting.sighting.view, setting.camera
    reach = int(np.ceil(2.5 * blur_px))
    expected = _blur(drawn, blur_px)
    recorded = _blur(view.tool_mask.astype(np.float32), blur_px)
    down, right = np.gradient(expected)
    unclear = ((view.mask == MaskLabel.OBJECT) | (view.mask == MaskLabel.UNKNOWN)).astype(np.uint8)
    band = (np.abs(down) + np.abs(right) > 0.05) & (cv2.dilate(unclear, _disc(reach + 1)) == 0)
    band[:reach], band[-reach:], band[:, :reach], band[:, -reach:] = False, False, False, False
    behind = cv2.dilate(depth, _disc(reach))
    rows, columns = np.nonzero(band & (behind > 0))
    if not len(rows):
        return NONE
    few = _few(camera, rows, columns)
    rows, columns = rows[few], columns[few]
    far = behind[rows, columns].astype(np.float64)
    high = _heights(camera, rows, columns, far) > floor_m + reach * far / camera.intrinsics[0, 0]
    rows, columns, far = rows[high], columns[high], far[high]
    points = camera.directions(columns + 0.5, rows + 0.5) * far[:, None]
    moved = setting.move(points, on_tool=True)
    focal = np.array([camera.intrinsics[0, 0], camera.intrinsics[1, 1]])
    flow = (
        focal[:, None] * (moved[:, :2] - (points[:, :2] / far[:, None])[..., None] * moved[:, 2:]) / far[:, None, None]
    )
    slope = np.stack([right[rows, columns], down[rows, columns]], -1)
    kinds = np.column_stack([-slope, np.linalg.norm(slope, axis=1)])
    patterns = np.zeros((len(slope), PATTERNS))
    patterns[:, 3:] = PIXEL_ERROR * np.einsum("nk,nf->nkf", kinds, _across(camera, rows, columns)).reshape(-1, 9)
    jacobian = -np.einsum("nk,nkp->np", slope, flow)
    jacobian[:, SLICES["tool_thickness"].start] = np.linalg.norm(slope * focal, axis=1) / far
    return Rows((recorded - expected)[rows, columns].astype(np.float64), jacobian, patterns)


def _across(camera: Camera, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Give 1, and where pixels are across the picture, -1 to 1 to the right and down, shape [N, 3]."""
    right, down = 2 * (columns + 0.5) / camera.width - 1, 2 * (rows + 0.5) / camera.height - 1
    return np.column_stack([np.ones(len(rows)), right, down])


def _heights(camera: Camera, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray) -> np.ndarray:
    points = camera.directions(columns + 0.5, rows + 0.5) * depth[:, None]
    return np.asarray(points @ camera.world_from_cam[2, :3] + camera.world_from_cam[2, 3])


def _blur(image: np.ndarray, blur_px: float) -> np.ndarray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE))


def _disc(reach: int) -> np.ndarray:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1)))


def _few(camera: Camera, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Choose about MOST_PIXELS pixels, always the same ones as far as they are there: so that a fit settles."""
    return np.asarray(_lots(camera.height, camera.width)[rows, columns] * len(rows) <= MOST_PIXELS)


@cache
def _lots(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).random((height, width))
