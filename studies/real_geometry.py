"""Measure fusion on real data: `python -m studies.real_geometry --data <folder> [--json <file>]`.

7-Scenes kitchen (50 posed depth frames): fused vertices, and how far each frame's depth lies from the volume
that all frames make, with the published poses and after registering the frames to each other.
RoboCook dough (4 calibrated cameras): distance of the authors' fused clouds, table taken off by us, to their own
filled and surface clouds of the dough, and overlap of the projected cloud with the dough's colour in each crop.
gs-dynamics rope (4 calibrated cameras): overlap of the projected cloud with the masks.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
from scipy.spatial import cKDTree

from plop.geometry.cameras import Camera
from plop.geometry.cloud_ply import read_cloud
from plop.geometry.plane import find_plane
from plop.geometry.pointcloud import cloud_from_depth, largest_clusters, surface_distance_m, voxel_average
from plop.geometry.registration import register
from plop.geometry.rigid import pose_from_quat_wxyz
from plop.geometry.tsdf import DepthFrame, fuse_tsdf

LINK_FROM_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def seven_scenes(folder: Path, step: int = 1, voxel_m: float = 0.01) -> dict:
    """Fuse the kitchen and compare every frame with the result."""
    frames = [scene_frame(path, folder) for path in sorted(folder.glob("*.color.jpg"))[::step]]
    start = time.perf_counter()
    published = fuse_tsdf(frames, voxel_m, max_depth_m=4.0)
    fuse_s = time.perf_counter() - start
    before = frame_to_model_mm(frames, voxel_m)
    clouds = []
    for frame in frames:
        thin = np.zeros(frame.depth_m.shape, bool)
        thin[::6, ::6] = True
        usable = thin & (frame.depth_m > 0) & (frame.depth_m < 4.0)
        clouds.append(voxel_average(cloud_from_depth(frame.camera, frame.depth_m, frame.rgb, usable), 0.02))
    start = time.perf_counter()
    found = register(clouds, gate_m=0.08, iterations=15, min_overlap=0.25)
    moved = [
        replace(f, camera=replace(f.camera, world_from_cam=m @ f.camera.world_from_cam))
        for f, m in zip(frames, found.corrections)
    ]
    return {
        "frames": len(frames),
        "voxel_mm": 1e3 * voxel_m,
        "vertices": len(published),
        "fuse_s": round(fuse_s, 1),
        "frame_to_model_mm": before,
        "register_s": round(time.perf_counter() - start, 1),
        "pairs": found.pairs,
        "cloud_to_cloud_mm": {"before": round(found.residual_before_mm, 2), "after": round(found.residual_after_mm, 2)},
        "vertices_after_icp": len(fuse_tsdf(moved, voxel_m, max_depth_m=4.0)),
        "frame_to_model_after_icp_mm": frame_to_model_mm(moved, voxel_m),
    }


def scene_frame(color: Path, folder: Path) -> DepthFrame:
    """Read one frame of 7-Scenes: depth in millimetres, 0 and 65535 not measured; pose made orthonormal."""
    stem = color.name.split(".")[0]
    raw = cv2.imread(str(folder / f"{stem}.depth.png"), cv2.IMREAD_UNCHANGED)
    depth = np.where(raw == 65535, 0, raw).astype(np.float32) / 1000
    pose = np.loadtxt(folder / f"{stem}.pose.txt")
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    matrix = np.loadtxt(folder / "camera-intrinsics.txt")
    rgb = cv2.cvtColor(cv2.imread(str(color)), cv2.COLOR_BGR2RGB)
    return DepthFrame(Camera(stem, depth.shape[1], depth.shape[0], matrix, pose), depth, rgb)


def frame_to_model_mm(frames: list[DepthFrame], voxel_m: float, every: int = 5) -> dict:
    """Compare every fifth frame with the surface of all other frames: it takes no part in what it is compared with."""
    medians, means, seen = [], [], []
    for index in range(0, len(frames), every):
        model = fuse_tsdf([frame for i, frame in enumerate(frames) if i != index], voxel_m, max_depth_m=4.0)
        depth = np.where(frames[index].depth_m < 4.0, frames[index].depth_m, 0)[::4, ::4]
        thin = np.zeros(frames[index].depth_m.shape, np.float32)
        thin[::4, ::4] = depth
        points = frames[index].camera.back_project(thin)
        error = np.abs(surface_distance_m(points, model, 0.1)) * 1e3
        medians.append(float(np.median(error)))
        means.append(float(error.mean()))
        seen.append(len(error) / len(points))
    return {
        "median": round(float(np.median(medians)), 2),
        "mean": round(float(np.mean(means)), 2),
        "share_within_100_mm": round(float(np.mean(seen)), 3),
    }


def robocook(folder: Path) -> dict:
    """Take the table off the authors' fused clouds; compare with their own dough clouds and with the cameras."""
    offsets = json.loads((folder / "crop_offsets_ESTIMATED.json").read_text())
    cameras = robocook_cameras(folder)
    rows = {}
    for key, crops in offsets.items():
        base = folder / key
        dough = without_table(read_cloud(base.with_name(base.name + "_raw.ply")).points)
        filled = positions(base.with_name(f"{base.name}_dense.h5"))
        surface = positions(base.with_name(f"{base.name}_surf.h5"))
        overlaps = {}
        for name, crop in crops.items():
            image = cv2.imread(str(base.with_name(f"{base.name}_{name}.png")))
            overlaps[name] = round(crop_overlap(dough, cameras[name], image, crop), 3)
        rows[key.removeprefix("target_shapes/")] = {
            "points": len(dough),
            "to_filled_mm": nearest_mm(dough, filled),
            "to_surface_mm": nearest_mm(dough, surface),
            "from_surface_mm": nearest_mm(surface, dough),
            "iou": overlaps,
        }
    every = [value for row in rows.values() for value in row["iou"].values()]
    keys = ("to_filled_mm", "to_surface_mm", "from_surface_mm")
    return {
        "objects": len(rows),
        "iou_median": round(float(np.median(every)), 3),
        "iou_min": min(every),
        **{f"{key}_median": round(float(np.median([row[key] for row in rows.values()])), 2) for key in keys},
        "rows": rows,
    }


def positions(path: Path) -> np.ndarray:
    """Read the points of one of the authors' HDF5 files, shape [N, 3] [m]."""
    with h5py.File(path) as file:
        return file["positions"][:]


def without_table(points: np.ndarray) -> np.ndarray:
    """Drop the dominant plane and everything below 1.5 mm above it, and keep the largest clusters."""
    height = find_plane(points, threshold_m=0.001).signed_distance(points)
    above = points[height > 0.0015]
    return above[largest_clusters(above, 0.006, at_least=0.5)]


def robocook_cameras(folder: Path) -> dict[str, Camera]:
    """Read poses (camera link in the robot's base, wxyz) and intrinsics (column by column)."""
    import yaml

    poses = yaml.safe_load((folder / "config" / "camera_pose_world.yml").read_text())
    out = {}
    for name, pose in poses.items():
        facts = json.loads((folder / "perception" / "config" / f"intrinsics_{name[-1]}.json").read_text())
        matrix = np.reshape(facts["intrinsic_matrix"], (3, 3)).T.copy()
        link = pose_from_quat_wxyz(np.array(pose["position"]), np.array(pose["orientation"]))
        out[name] = Camera(name, facts["width"], facts["height"], matrix, link @ LINK_FROM_OPTICAL)
    return out


def nearest_mm(points: np.ndarray, others: np.ndarray) -> float:
    """Mean distance to the nearest point of another cloud [mm]."""
    return round(float(cKDTree(others).query(points)[0].mean() * 1e3), 3)


def crop_overlap(points: np.ndarray, camera: Camera, image: np.ndarray, crop: dict) -> float:
    """Overlap (IoU) of the projected cloud, closed, with the dough's colour in one crop."""
    pixels, depth = camera.project(points)
    places = np.round(pixels[depth > 0] - [crop["x0"], crop["y0"]]).astype(int)
    inside = ((places >= 0) & (places < [image.shape[1], image.shape[0]])).all(1)
    drawn = np.zeros(image.shape[:2], np.uint8)
    drawn[places[inside, 1], places[inside, 0]] = 1
    drawn = cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)).astype(bool)
    mask = dough_mask(image, drawn)
    return float((mask & drawn).sum() / max((mask | drawn).sum(), 1))


def dough_mask(image: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    """Segment the dough by colour (GrabCut, started from the projected cloud: nearby is probable, far is not)."""
    labels = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    labels[cv2.dilate(drawn.astype(np.uint8), np.ones((41, 41))) > 0] = cv2.GC_PR_BGD
    labels[drawn] = cv2.GC_PR_FGD
    cv2.setRNGSeed(0)
    cv2.grabCut(image, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), 5, cv2.GC_INIT_WITH_MASK)
    return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def rope(folder: Path) -> dict:
    """Project the rope's cloud into its four masks."""
    rotations, shifts, matrices = (np.load(folder / f"{n}_list.npy", allow_pickle=False) for n in ("R", "t", "intr"))
    points = read_cloud(folder / "pcd.ply").points
    rows = {}
    for index in range(4):
        mask = cv2.imread(str(folder / f"mask_{index}.png"), cv2.IMREAD_GRAYSCALE) > 0
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotations[index], shifts[index].reshape(3)
        camera = Camera(str(index), mask.shape[1], mask.shape[0], matrices[index], pose)
        places = np.round(camera.project(points)[0]).astype(int)
        drawn = np.zeros(mask.shape, np.uint8)
        good = ((places >= 0) & (places < [mask.shape[1], mask.shape[0]])).all(1)
        drawn[places[good, 1], places[good, 0]] = 1
        wide = cv2.dilate(drawn, np.ones((5, 5), np.uint8)).astype(bool)
        rows[f"view_{index}"] = {
            "recall": round(float((wide & mask).sum() / mask.sum()), 3),
            "iou": round(float((wide & mask).sum() / (wide | mask).sum()), 3),
        }
    return rows


def main() -> None:
    """Run what data there is and write one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with tsdf_7scenes, robocook_dough, ...")
    parser.add_argument("--json", type=Path, default=None, help="write here instead of standard output")
    parser.add_argument("--only", default=None, help="name of one data set")
    options = parser.parse_args()
    parts = {"tsdf_7scenes": seven_scenes, "robocook_dough": robocook, "gs_dynamics_demo": rope}
    wanted = [name for name in parts if options.only in (None, name) and (options.data / name).is_dir()]
    found = {name: parts[name](options.data / name) for name in wanted}
    text = json.dumps(found, indent=1)
    if options.json:
        options.json.write_text(text + "\n")
    else:
        print(text)


if __name__ == "__main__":
    main()
