"""Render a textured mesh, a tool and a table by ray casting: colour, exact depth, exact labels.

Needs no GPU and no window. Depth and labels come from the ray through the middle of each pixel,
colour is the mean over a grid of rays in the pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from plop.geometry.cameras import Camera
from plop.geometry.rays import pixel_rays, window
from plop.geometry.rigid import transform_points
from plop.geometry.view import MaskLabel, View
from plop.lazy_open3d import o3d
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.render.virtual_cameras.texture import SolidTexture

_CREASE_COS = np.cos(np.radians(40.0))
"""Neighbouring faces at a smaller angle are shaded as one smooth surface."""


@dataclass(frozen=True)
class Light:
    """Constant light plus one distant, fixed lamp."""

    ambient: float = 0.75
    """Brightness of a face turned away from the lamp."""
    directional: float = 0.25
    """Brightness added to a face turned towards the lamp."""
    direction: tuple[float, float, float] = (0.3, -0.4, 0.87)
    """Direction of the lamp from the object; any length."""

    def shade(self, normals: np.ndarray) -> np.ndarray:
        """Return the brightness of faces with these unit normals, shape [N, 3] -> [N, 1]."""
        toward = np.asarray(self.direction, np.float32)
        toward = toward / np.linalg.norm(toward)
        return self.ambient + self.directional * np.clip(normals @ toward, 0, None)[:, None]


@dataclass(frozen=True)
class Look:
    """Colours of the scene."""

    texture: SolidTexture
    light: Light = Light()
    tool: tuple[float, float, float] = (0.50, 0.53, 0.56)
    table: tuple[float, float, float] = (0.80, 0.79, 0.77)
    nothing: tuple[float, float, float] = (0.90, 0.90, 0.90)
    """Colour where a ray hits nothing."""


_Images = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Colour [H, W, 3] uint8, depth [H, W] float32 [m] (0 where the ray hits nothing) and MaskLabel [H, W] uint8; the table
is background."""


class MeshRenderer:
    """Renderer of one mesh sequence; stores the data that are constant over frames.

    Args:
        sequence: The episode.
        look: Colours.
        supersample: Rays along each side of a pixel; odd, so that one goes through the middle.
        table_half_m: Half the edge of the square table, centred under the object [m].
    """

    def __init__(self, sequence: MeshSequence, look: Look, *, supersample: int = 3, table_half_m: float = 1.5) -> None:
        if supersample < 1 or supersample % 2 == 0:
            raise ValueError(f"supersample must be odd, got {supersample}")
        self.sequence, self.look, self.supersample = sequence, look, supersample
        self._smoothing = _corner_smoothing(sequence.rest, sequence.faces, sequence.is_cut_face)
        self._corner_rest = sequence.rest[sequence.faces].astype(np.float32)
        self._table_half_m = table_half_m
        self._static: dict[str, tuple[np.ndarray, _Images]] = {}
        self._frame = -1

    def render(self, frame: int, camera: Camera) -> View:
        """Render one frame of one camera; fastest when all cameras of a frame are rendered in a row."""
        if frame != self._frame:
            self._build(frame)
        rays, empty = self._prepared(camera)
        rows, columns = window(camera, self._moving)
        rgb, depth, mask = (image.copy() for image in empty)
        if rows.start < rows.stop and columns.start < columns.stop:
            rgb[rows, columns], depth[rows, columns], mask[rows, columns] = self._cast(rays[rows, columns])
        return View(camera, rgb, depth, mask)

    def _cast(self, rays: np.ndarray) -> _Images:
        """Shade a grid of pixels, rays [h, w, S*S, 6], in the scene of the current frame."""
        hits = self._scene.cast_rays(o3d.core.Tensor.from_numpy(np.ascontiguousarray(rays)))
        height, width, count = rays.shape[:3]
        part = hits["geometry_ids"].numpy().reshape(height, width, count)
        colour = self._colour(
            part.reshape(-1),
            hits["primitive_ids"].numpy().reshape(-1),
            hits["primitive_uvs"].numpy().reshape(-1, 2),
            hits["primitive_normals"].numpy().reshape(-1, 3),
        )
        rgb = np.einsum("hwsc->hwc", colour.reshape(height, width, count, 3)) / count
        depth, centre = hits["t_hit"].numpy().reshape(part.shape)[..., count // 2], part[..., count // 2]
        mask = np.full(centre.shape, MaskLabel.BACKGROUND, np.uint8)
        mask[centre == self._object_id] = MaskLabel.OBJECT
        mask[centre == self._tool_id] = MaskLabel.TOOL
        depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
        return np.round(rgb * 255).clip(0, 255).astype(np.uint8), depth, mask

    def _build(self, frame: int) -> None:
        sequence = self.sequence
        vertices = sequence.vertices[frame]
        tool = transform_points(sequence.world_from_tool[frame], sequence.tool_vertices)
        self._scene = o3d.t.geometry.RaycastingScene()
        self._table_id = self._add_table(self._scene)
        self._object_id = _add(self._scene, vertices, sequence.faces)
        self._tool_id = _add(self._scene, tool, sequence.tool_faces)
        self._moving = np.concatenate([vertices, tool])
        corner = vertices[sequence.faces]
        area_normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self._corner_normals = (self._smoothing @ area_normals).reshape(-1, 3, 3).astype(np.float32)
        self._frame = frame

    def _add_table(self, scene: o3d.t.geometry.RaycastingScene) -> int:
        if self.sequence.table_z_m is None:
            return -1
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self._table_half_m
        corners = corners + self.sequence.rest.mean(0)[:2]
        table = np.column_stack([corners, np.full(4, self.sequence.table_z_m)])
        return _add(scene, table, np.array([[0, 1, 2], [0, 2, 3]]))

    def _prepared(self, camera: Camera) -> tuple[np.ndarray, _Images]:
        """Return a camera's rays and its images of the empty table, computed once."""
        key = repr((camera.width, camera.height, camera.intrinsics.tolist(), camera.world_from_cam.tolist()))
        if key not in self._static:
            rays = pixel_rays(camera, self.supersample)
            scene = self._scene
            self._scene = o3d.t.geometry.RaycastingScene()
            self._add_table(self._scene)
            self._static[key] = rays, self._cast(rays)
            self._scene = scene
        return self._static[key]

    def _colour(self, part: np.ndarray, face: np.ndarray, uv: np.ndarray, normals: np.ndarray) -> np.ndarray:
        look, sequence = self.look, self.sequence
        out = np.broadcast_to(np.array(look.nothing, np.float32), (len(part), 3)).copy()
        out[part == self._table_id] = look.table
        tool = np.flatnonzero(part == self._tool_id)
        out[tool] = np.array(look.tool, np.float32) * look.light.shade(normals[tool])
        hit = np.flatnonzero(part == self._object_id)
        if len(hit):
            face, uv = face[hit], uv[hit]
            weights = np.column_stack([1 - uv[:, 0] - uv[:, 1], uv])
            points = np.einsum("nkc,nk->nc", self._corner_rest[face], weights)
            normal = np.einsum("nkc,nk->nc", self._corner_normals[face], weights)
            normal /= np.sqrt(np.einsum("nc,nc->n", normal, normal))[:, None].clip(1e-20)
            out[hit] = look.texture.colour(points, sequence.is_cut_face[face]) * look.light.shade(normal)
        return out


def _add(scene: o3d.t.geometry.RaycastingScene, vertices: np.ndarray, faces: np.ndarray) -> int:
    positions = o3d.core.Tensor.from_numpy(np.ascontiguousarray(vertices, np.float32))
    indices = o3d.core.Tensor.from_numpy(np.ascontiguousarray(faces, np.uint32))
    return int(scene.add_triangles(positions, indices))


def _corner_smoothing(rest: np.ndarray, faces: np.ndarray, is_cut: np.ndarray) -> csr_matrix:
    """Build the matrix [3F, F] that sums, for each corner of a face, the normals of its smooth neighbours."""
    corner = rest[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-20)
    count = len(faces)
    incidence = csr_matrix((np.ones(3 * count), (np.arange(3 * count), faces.reshape(-1))))
    vertex_of_face = csr_matrix((np.ones(3 * count), (np.repeat(np.arange(count), 3), faces.reshape(-1))))
    shared = (incidence @ vertex_of_face.T).tocoo()
    own = shared.row // 3
    smooth = (normal[own] * normal[shared.col]).sum(1) > _CREASE_COS
    keep = (smooth & (is_cut[own] == is_cut[shared.col])) | (own == shared.col)
    return csr_matrix((np.ones(int(keep.sum())), (shared.row[keep], shared.col[keep])), shape=(3 * count, count))
