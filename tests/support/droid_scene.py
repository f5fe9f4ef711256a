"""A small scene in front of a robot: table, block, knife; rendered from known cameras for DROID tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
import open3d as o3d
import trimesh
from scipy.spatial.transform import Rotation

from plop.geometry.cameras import Camera, look_at
from plop.geometry.rigid import pose_from_euler_xyz, transform_points
from plop.geometry.view import MaskLabel
from plop.recordings.readers.droid.writer import RawCamera, write_droid_episode
from plop.recordings.recording import Mesh

TABLE_Z = 0.02
BLOCK = np.array([[0.46, -0.05, TABLE_Z], [0.54, 0.05, TABLE_Z + 0.06]])
KNIFE_SIZE = (0.12, 0.004, 0.05)
FLANGE_FROM_TOOL = [0.0, 0.0, 0.24, 0.0, 0.0, 0.0]
WORKSPACE = {"min": [0.35, -0.15, 0.0], "max": [0.65, 0.15, 0.3]}
EXT1, EXT2, WRIST = "11110001", "11110002", "22220000"


def knife() -> Mesh:
    box = trimesh.creation.box(KNIFE_SIZE)
    return Mesh(np.asarray(box.vertices, float), np.asarray(box.faces, np.int64))


def pose6(matrix: np.ndarray) -> np.ndarray:
    return np.concatenate([matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3]).as_euler("xyz")])


def flange_path(rows: int, *, low: float = 0.06, high: float = 0.22) -> np.ndarray:
    """The flange above the block, z axis down, coming down so that the knife enters it."""
    height = np.linspace(high, low, rows) + FLANGE_FROM_TOOL[2]
    return np.stack([[0.5, 0.0, z, np.pi, 0.0, 0.0] for z in height])


@dataclass
class Scene:
    """Renders the scene; `knife_in` shows the knife too."""

    width: int = 64
    height: int = 48
    focal: float = 60.0
    block: np.ndarray = field(default_factory=lambda: BLOCK.copy())

    @property
    def intrinsics(self) -> np.ndarray:
        """K with pixel centres at half-integers."""
        return np.array([[self.focal, 0, self.width / 2], [0, self.focal, self.height / 2], [0, 0, 1.0]])

    @property
    def stored_intrinsics(self) -> np.ndarray:
        """K as DROID stores it: pixel centres at integers."""
        matrix = self.intrinsics
        matrix[:2, 2] -= 0.5
        return matrix

    def camera(self, world_from_cam: np.ndarray, name: str = "c") -> Camera:
        return Camera(name, self.width, self.height, self.intrinsics, world_from_cam)

    def render(self, world_from_cam: np.ndarray, world_from_tool: np.ndarray | None, rays_per_side: int = 3):
        """rgb, depth [m], mask (MaskLabel)."""
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        box = trimesh.creation.box(self.block[1] - self.block[0])
        table = np.array([[-1.0, -2, TABLE_Z], [2, -2, TABLE_Z], [2, 2, TABLE_Z], [-1, 2, TABLE_Z]])
        _add(scene, table, np.array([[0, 1, 2], [0, 2, 3]]))
        _add(scene, np.asarray(box.vertices) + self.block.mean(0), np.asarray(box.faces))
        if world_from_tool is not None:
            tool = knife()
            _add(scene, transform_points(world_from_tool, tool.vertices), tool.faces)
        camera = self.camera(world_from_cam)
        fine = camera.resized(camera.width * rays_per_side, camera.height * rays_per_side)
        directions = fine.pixel_directions() @ world_from_cam[:3, :3].T
        origin = np.broadcast_to(world_from_cam[:3, 3], directions.shape)
        hits = scene.cast_rays(o3d.core.Tensor(np.concatenate([origin, directions], -1).astype(np.float32)), nthreads=1)
        depth = np.where(np.isfinite(hits["t_hit"].numpy()), hits["t_hit"].numpy(), 0)
        part = hits["geometry_ids"].numpy()
        points = origin + directions * depth[..., None]
        rgb = _paint(points, part, hits["primitive_normals"].numpy())
        small = (camera.height, rays_per_side, camera.width, rays_per_side)
        middle = (slice(None), rays_per_side // 2, slice(None), rays_per_side // 2)
        labels = np.array([MaskLabel.BACKGROUND, MaskLabel.OBJECT, MaskLabel.TOOL], np.uint8)
        part = part.reshape(small)[middle]
        mask = np.where(part < 3, labels[np.minimum(part, 2)], MaskLabel.BACKGROUND).astype(np.uint8)
        colour = rgb.reshape(*small, 3).mean((1, 3))
        return colour.round().astype(np.uint8), depth.reshape(small)[middle].astype(np.float32), mask


def _add(scene, vertices, faces) -> None:
    corners, triangles = np.asarray(vertices, np.float32), np.asarray(faces, np.uint32)
    scene.add_triangles(o3d.core.Tensor(corners), o3d.core.Tensor(triangles))


def _paint(points: np.ndarray, part: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """A texture in space, so that both eyes of a stereo camera see the same."""
    wave = sum(
        np.sin(points @ np.array(k) + p)
        for k, p in [((190, 70, 40), 0), ((-60, 230, 90), 1), ((110, -140, 260), 2), ((330, 210, -120), 3)]
    )
    base = np.array([[150, 150, 150], [200, 90, 60], [60, 70, 110], [20, 20, 20]], float)[np.minimum(part, 3)]
    shade = 0.8 + 0.2 * np.abs(normals @ np.array([0.4, 0.3, 0.86]))
    return (base * shade[..., None] + 10 * wave[..., None]).clip(0, 255)


def exterior_poses() -> dict[str, np.ndarray]:
    target = np.array([0.5, 0.0, 0.05])
    return {
        EXT1: look_at(np.array([0.75, -0.45, 0.45]), target, np.array([0, 0, 1.0])),
        EXT2: look_at(np.array([0.7, 0.5, 0.4]), target, np.array([0, 0, 1.0])),
    }


def wrist_offset() -> np.ndarray:
    """Camera in flange: beside the hand, looking along the flange's z axis and a little inwards."""
    return look_at(np.array([-0.10, 0.0, -0.05]), np.array([0.0, 0.0, 0.25]), np.array([-1.0, 0, 0.0]))


def right_eye(world_from_cam: np.ndarray, baseline: float) -> np.ndarray:
    out = world_from_cam.copy()
    out[:3, 3] += baseline * world_from_cam[:3, 0]
    return out


def make_episode(
    root: Path,
    *,
    rows: int = 12,
    scene: Scene | None = None,
    stereo: bool = False,
    depth: bool = True,
    intrinsics: bool = True,
    baseline: float = 0.12,
    notes: dict | None = None,
    flange6: np.ndarray | None = None,
    moment: datetime = datetime(2023, 8, 6, 22, 13, 4),
    lag_ms: int = 0,
    serials: tuple[str, ...] = (EXT1, EXT2, WRIST),
    **kwargs,
) -> Path:
    """Write one episode as raw DROID data; the knife mesh lies in the raw folder."""
    scene = scene or Scene()
    root.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(*(getattr(knife(), key) for key in ("vertices", "faces"))).export(root / "knife.stl")
    flange6 = flange_path(rows) if flange6 is None else flange6
    flange = pose_from_euler_xyz(flange6)
    tools = flange @ pose_from_euler_xyz(np.asarray(FLANGE_FROM_TOOL))
    cameras = []
    for number, serial in enumerate(serials):
        kind = 0 if serial == WRIST else number + 1
        local = wrist_offset() if serial == WRIST else exterior_poses()[serial]
        poses = [pose @ local if kind == 0 else local for pose in flange]
        shots = [scene.render(pose, tool) for pose, tool in zip(poses, tools)]
        right = [scene.render(right_eye(p, baseline), t)[0] for p, t in zip(poses, tools)] if stereo else None
        cameras.append(
            RawCamera(
                serial,
                kind,
                [s[0] for s in shots],
                pose6(local),
                right,
                pose6(right_eye(local, baseline)),
                scene.stored_intrinsics if intrinsics else None,
                [s[1] for s in shots] if depth else None,
            )
        )
    default = {
        "tool": {"mesh": "../../../../knife.stl", "flange_from_tool": FLANGE_FROM_TOOL},
        "workspace": WORKSPACE,
        "table_z": TABLE_Z,
    }
    return write_droid_episode(
        root, cameras, flange6, moment=moment, pose_lag_ms=lag_ms, notes={**default, **(notes or {})}, **kwargs
    )


def world_from_tool(flange6: np.ndarray) -> np.ndarray:
    return pose_from_euler_xyz(flange6) @ pose_from_euler_xyz(np.asarray(FLANGE_FROM_TOOL))
