"""How often `calibrate` blames right cameras, and finds faults that all share: `python -m studies.depth_checks`.

Made-up cells: a finite table that may be tilted by up to 1 deg, an object, clutter, a knife held by a hand, a floor and
a wall; 2 to 4 cameras of 64 to 320 px at random places; depth noise of 0 to 2 mm, holes and frayed outlines. Every
fault is on all cameras, so that they may well agree with each other. Writes docs/results/depth_checks.json.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d
import trimesh

from plop.geometry.cameras import Camera, look_at
from plop.recordings.recording import Mesh, Recording, View
from plop.recordings.writer import RecordingWriter
from plop.sensors.depth_edges import edge_alignment, tolerance_px
from stages.calibrate.episode import calibrate_episode
from stages.calibrate.stage import CalibrateConfig

RESULT = Path(__file__).resolve().parent.parent / "docs" / "results" / "depth_checks.json"
KNIFE = (0.12, 0.004, 0.05)
Shot = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Cell:
    """One made-up cell and what stands in it."""

    parts: list[tuple[trimesh.Trimesh, int, tuple[float, float, float]]]
    """Mesh, label, colour; the knife and the hand are in their own frame and last."""
    cameras: list[Camera]
    tool_poses: np.ndarray
    noise_m: float
    fray_px: int
    texture: float


def draw_cell(seed: int) -> Cell:
    """Draw a cell."""
    rng = np.random.default_rng(seed)
    tilt = trimesh.transformations.rotation_matrix(np.radians(rng.uniform(0, 1)), [*rng.normal(size=2), 0])
    size = rng.uniform([0.5, 0.6], [1.2, 1.4])
    table = trimesh.creation.box((*size, 0.03))
    table.apply_translation([0, 0, -0.015])
    table.apply_transform(tilt)
    body = (
        trimesh.creation.box(rng.uniform([0.05, 0.05, 0.03], [0.12, 0.1, 0.08]))
        if rng.random() < 0.5
        else (trimesh.creation.icosphere(3))
    )
    if len(body.vertices) > 8:
        body.apply_scale(rng.uniform([0.03, 0.03, 0.02], [0.06, 0.05, 0.04]))
    body.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0, 6.3), [0, 0, 1]))
    body.apply_translation([0, 0, -body.bounds[0, 2]])
    grey = rng.uniform(90, 200)
    parts = [(table, 0, (grey, grey, grey)), (body, 1, tuple(rng.uniform(30, 230, 3)))]
    for box in (trimesh.creation.box((6, 6, 0.1)), trimesh.creation.box((6, 0.1, 4))):
        box.apply_translation([0, 0, -0.8] if box.extents[2] < 1 else [0, 1.6, 0])
        parts.append((box, 0, tuple(rng.uniform(60, 180, 3))))
    for _ in range(rng.integers(0, 3)):
        thing = trimesh.creation.box(rng.uniform(0.03, 0.1, 3))
        angle, far = rng.uniform(0, 6.3), rng.uniform(0.17, 0.24)
        thing.apply_translation([far * np.cos(angle), far * np.sin(angle), thing.extents[2] / 2])
        parts.append((thing, 0, tuple(rng.uniform(30, 230, 3))))
    hand = trimesh.creation.cylinder(0.03, 0.3)
    hand.apply_translation([0, 0, 0.19])
    parts += [(trimesh.creation.box(KNIFE), 2, tuple(rng.uniform(40, 200, 3))), (hand, 255, (50, 50, 60))]
    width = int(rng.choice([64, 96, 160, 320]))
    height = int(width * rng.choice([0.75, 1.0]))
    cameras = []
    start = rng.uniform(0, 6.3)
    for number in range(rng.integers(2, 5)):
        turn, up, far = start + number * rng.uniform(1.1, 1.9), np.radians(rng.uniform(25, 65)), rng.uniform(0.45, 0.9)
        eye = far * np.array([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)])
        focal = width / (2 * np.tan(np.radians(rng.uniform(45, 80)) / 2))
        matrix = np.array([[focal, 0, width / 2 + rng.normal()], [0, focal, height / 2 + rng.normal()], [0, 0, 1]])
        pose = look_at(eye, rng.normal(scale=0.03, size=3) + [0, 0, 0.03], np.array([0, 0, 1.0]))
        cameras.append(Camera(f"cam{number}", width, height, matrix, pose))
    poses = np.tile(np.eye(4), (3, 1, 1))
    turn = rng.uniform(0, 6.3)
    poses[:, :2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    poses[:, 2, 3] = np.linspace(0.17, body.bounds[1, 2] + 0.01, 3)
    noise_m = float(rng.choice([0, 0.001, 0.002]))
    # a sensor's outlines are frayed by up to 4 px at 640 px; stored pictures are smaller
    fray_px = round(rng.uniform(0, 4) * width / 640)
    return Cell(parts, cameras, poses, noise_m, fray_px, float(rng.uniform(0, 25)))


def shoot(cell: Cell, camera: Camera, tool: np.ndarray, rng: np.random.Generator) -> Shot:
    """Take one picture: rgb, depth [m] with the sensor's faults, labels."""
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    for number, (mesh, _, _) in enumerate(cell.parts):
        at = tool if number >= len(cell.parts) - 2 else np.eye(4)
        corners = trimesh.transform_points(mesh.vertices, at).astype(np.float32)
        scene.add_triangles(o3d.core.Tensor(corners), o3d.core.Tensor(mesh.faces.astype(np.uint32)))
    fine = camera.resized(3 * camera.width, 3 * camera.height)
    rays = fine.pixel_directions() @ camera.world_from_cam[:3, :3].T
    origin = np.broadcast_to(camera.world_from_cam[:3, 3], rays.shape)
    hits = scene.cast_rays(o3d.core.Tensor(np.concatenate([origin, rays], -1).astype(np.float32)), nthreads=1)
    depth = np.nan_to_num(hits["t_hit"].numpy(), posinf=0.0)
    part = np.minimum(hits["geometry_ids"].numpy(), len(cell.parts)).astype(int)
    points = origin + rays * depth[..., None]
    colours = np.array([*[colour for *_, colour in cell.parts], (20, 20, 20)])
    wave = sum(np.sin(points @ np.array(k)) for k in ((190, 70, 40), (-60, 230, 90), (110, -140, 260)))
    shade = 0.75 + 0.25 * np.abs(hits["primitive_normals"].numpy() @ np.array([0.4, 0.3, 0.86]))
    rgb = (colours[part] * shade[..., None] + cell.texture * wave[..., None]).clip(0, 255).astype(np.float32)
    rgb = cv2.resize(rgb, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    rgb = (rgb + rng.normal(scale=3, size=rgb.shape)).clip(0, 255).astype(np.uint8)
    labels = np.array([*[label for _, label, _ in cell.parts], 0], np.uint8)[part][1::3, 1::3]
    return rgb, _sensed(depth[1::3, 1::3], cell, rng), labels


def _sensed(depth: np.ndarray, cell: Cell, rng: np.random.Generator) -> np.ndarray:
    rows, columns = np.indices(depth.shape)
    fray = [cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 1.5) * 5 * cell.fray_px for _ in range(2)]
    rows = (rows + fray[0].round().astype(int).clip(-cell.fray_px, cell.fray_px)).clip(0, depth.shape[0] - 1)
    columns = (columns + fray[1].round().astype(int).clip(-cell.fray_px, cell.fray_px)).clip(0, depth.shape[1] - 1)
    frayed = depth[rows, columns]
    # frayed outlines only: on a surface this would be noise in depth
    step = cv2.dilate(depth, np.ones((5, 5))) - cv2.erode(depth, np.ones((5, 5))) > 0.04 + 0.05 * depth
    out = np.where(step, frayed, depth)
    out = np.where(out > 0, out + rng.normal(scale=cell.noise_m, size=out.shape) if cell.noise_m else out, 0)
    out[rng.random(out.shape) < 0.01] = 0
    return np.round(out, 3).astype(np.float32) if cell.noise_m else out.astype(np.float32)


Faulty = Callable[[Cell, Camera, np.ndarray, np.random.Generator], Shot]


def unaligned(zoom: float, aside_m: float) -> Faulty:
    """Depth from another lens beside the colour camera, wider by `zoom`."""

    def take(cell: Cell, camera: Camera, tool: np.ndarray, rng: np.random.Generator) -> Shot:
        rgb, _, labels = shoot(cell, camera, tool, rng)
        matrix = camera.intrinsics * np.array([[1 / zoom], [1 / zoom], [1]])
        matrix[:2, 2] = camera.width / 2, camera.height / 2
        pose = camera.world_from_cam.copy()
        pose[:3, 3] -= aside_m * pose[:3, 0]
        _, depth, seen = shoot(cell, replace(camera, intrinsics=matrix, world_from_cam=pose), tool, rng)
        return rgb, depth, seen

    return take


def changed_depth(change: Callable[[Camera, np.ndarray], np.ndarray]) -> Faulty:
    """Depth that is something else."""

    def take(cell: Cell, camera: Camera, tool: np.ndarray, rng: np.random.Generator) -> Shot:
        rgb, depth, labels = shoot(cell, camera, tool, rng)
        return rgb, change(camera, depth).astype(np.float32), labels

    return take


def turned(turn: Callable[[np.ndarray], np.ndarray]) -> Faulty:
    """Pictures that are turned or mirrored."""
    return lambda *args: tuple(np.ascontiguousarray(turn(picture)) for picture in shoot(*args))  # type: ignore[return-value]


def ray_length(camera: Camera) -> np.ndarray:
    """Length of every pixel's ray with 1 along the axis, [H, W]."""
    return np.linalg.norm(camera.pixel_directions(), axis=-1)


FAULTS: dict[str, tuple[Faulty, str]] = {
    "unaligned, zoom 1.4, 15 mm aside": (unaligned(1.4, 0.015), "unaligned"),
    "unaligned, zoom 0.9, 25 mm aside": (unaligned(0.9, 0.025), "unaligned"),
    "unaligned, 25 mm aside": (unaligned(1.0, 0.025), "unaligned"),
    "distance along the ray": (changed_depth(lambda c, d: d * ray_length(c)), "distance"),
    "depth scale 1.01": (changed_depth(lambda c, d: d * 1.01), "table"),
    "depth scale 1.02": (changed_depth(lambda c, d: d * 1.02), "table"),
    "depth scale 1.03": (changed_depth(lambda c, d: d * 1.03), "table"),
    "depth scale 0.95": (changed_depth(lambda c, d: d * 0.95), "table"),
    "turned by 180 deg": (turned(lambda p: p[::-1, ::-1]), "turned"),
    "mirrored top to bottom": (turned(lambda p: p[::-1]), "turned"),
    "mirrored left to right": (turned(lambda p: p[:, ::-1]), "turned"),
}
TOOLS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tool: y up": lambda v: np.stack([v[:, 0], v[:, 2], -v[:, 1]], 1),
    "tool: x along z": lambda v: np.stack([v[:, 2], v[:, 1], -v[:, 0]], 1),
    "tool: x and y swapped": lambda v: np.stack([v[:, 1], v[:, 0], v[:, 2]], 1),
    "tool: 40 mm off": lambda v: v + [0.0, 0.04, 0.0],
}


def judged(
    seed: int, folder: Path, take: Faulty = shoot, mesh: Callable[[np.ndarray], np.ndarray] | None = None
) -> list[dict]:
    """Record a cell and judge its cameras; gives their verdicts."""
    cell, rng = draw_cell(seed), np.random.default_rng(seed + 10_000)
    knife = trimesh.creation.box(KNIFE)
    vertices = np.asarray(knife.vertices) if mesh is None else mesh(np.asarray(knife.vertices))
    path = folder / "cell.h5"
    frames = len(cell.tool_poses)
    with RecordingWriter(
        path,
        name="cell",
        source="test",
        environment="cell",
        table_z_m=0.0,
        time_s=np.arange(frames) / 10,
        tool_mesh=Mesh(vertices, np.asarray(knife.faces)),
        world_from_tool=cell.tool_poses,
    ) as writer:
        for camera in cell.cameras:
            writer.add_camera(
                camera.name,
                camera.intrinsics,
                np.tile(camera.world_from_cam, (frames, 1, 1)),
                camera.height,
                camera.width,
            )
            for frame in range(frames):
                writer.write_frame(camera.name, frame, *take(cell, camera, cell.tool_poses[frame], rng))
    with Recording(path) as recording:
        found = calibrate_episode(recording, CalibrateConfig(time_offset=False))
    return [vars(each) for each in found.cameras]


def seven_scenes(folder: Path) -> list[dict]:
    """Hold real depth against its colour: 7 Scenes as published, whose depth is not aligned, and aligned.

    Aligned by the usual Kinect: colour 525 px, depth 585 px of focal length, 25 mm apart, at 320 x 240 px.
    """
    rows = []
    matrix = np.array([[292.5, 0, 160], [0, 292.5, 120], [0, 0, 1]])
    for name in ("7 Scenes as published", "7 Scenes, depth aligned"):
        count = told = moved = 0
        for path in sorted(folder.glob("frame-*.depth.png")):
            millimetres = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            depth = np.where(millimetres < 60_000, millimetres, 0).astype(np.float32) / 1000
            picture = cv2.imread(str(path).replace("depth.png", "color.jpg"))
            rgb = cv2.resize(picture, (320, 240), interpolation=cv2.INTER_AREA)
            depth = depth[::2, ::2] if "published" in name else _onto_colour(depth)
            view = View(Camera("kinect", 320, 240, matrix, np.eye(4)), rgb, depth, np.zeros(depth.shape, np.uint8))
            found = edge_alignment([view])
            count += 1
            told += found is not None and found.tells
            moved += found is not None and found.moved(tolerance_px(320))
        rows.append({"set": name, "pictures": count, "told": told, "moved": moved})
        print(rows[-1], flush=True)
    return rows


def _onto_colour(depth: np.ndarray) -> np.ndarray:
    """Draw measured points into the colour camera, the nearest of a pixel last; [480, 640] -> [240, 320]."""
    rows, columns = np.nonzero(depth > 0)
    z = depth[rows, columns]
    order = np.argsort(-z)
    x = (columns - 319.5) / 585 * z - 0.025
    u = (262.5 * x / z + 160)[order].astype(int)
    v = (262.5 * (rows - 239.5) / 585 + 120)[order].astype(int)
    inside = (u >= 0) & (u < 320) & (v >= 0) & (v < 240)
    out = np.zeros((240, 320), np.float32)
    out[v[inside], u[inside]] = z[order][inside]
    return out


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.depth_checks", description=__doc__)
    parser.add_argument("--right", type=int, default=48, help="right recordings")
    parser.add_argument("--wrong", type=int, default=8, help="recordings of each fault")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--out", type=Path, default=RESULT)
    parser.add_argument("--seven-scenes", type=Path, help="folder of 7 Scenes frames, in addition")
    parser.add_argument("--only", default="", help="faults whose name holds this")
    options = parser.parse_args()
    rows = seven_scenes(options.seven_scenes) if options.seven_scenes else []
    sets: list[tuple[str, str, int, dict]] = [("right", "", options.right, {})]
    sets += [(name, kind, options.wrong, {"take": take}) for name, (take, kind) in FAULTS.items()]
    sets += [(name, "tool", options.wrong, {"mesh": mesh}) for name, mesh in TOOLS.items()]
    with tempfile.TemporaryDirectory() as folder:
        for name, kind, count, what in sets:
            if options.only not in name or not count:
                continue
            words, kinds, named, other = Counter[str](), Counter[str](), 0, 0
            cameras = checks = unusable = 0
            for seed in range(options.first, options.first + count):
                verdicts = judged(seed, Path(folder), **what)
                cameras += len(verdicts)
                words.update(each["verdict"] for each in verdicts)
                kinds.update(each["faults"][0] for each in verdicts if each["faults"])
                unusable += sum(not each["usable"] for each in verdicts)
                checks += sum(bool(each["checks"]) for each in verdicts)
                found = [each["faults"][:1] == (kind,) for each in verdicts]
                named += any(found)
                other += any(each["faults"] and each["faults"][0] != kind for each in verdicts)
                if not kind and any(each["faults"] or not each["usable"] for each in verdicts):
                    print(seed, [(each["camera"], each["faults"], each["fix"]) for each in verdicts], flush=True)
            rows.append(
                {
                    "set": name,
                    "recordings": count,
                    "cameras": cameras,
                    "named": named,
                    "other_named": other,
                    "unusable": unusable,
                    "verdicts": dict(words),
                    "kinds": dict(kinds),
                    "checked_cameras": checks,
                }
            )
            print(rows[-1], flush=True)
    options.out.write_text(json.dumps({"first_seed": options.first, "rows": rows}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
