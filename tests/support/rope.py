"""The real rope of gs-dynamics' demo: four photographs with masks and cameras, and a cloud; no depth images."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree

from plop.geometry.cameras import Camera
from plop.geometry.ply import read_vertices
from plop.recordings.recording import MaskLabel, View
from stages.fit_init.shell import Surface

_NEIGHBOURS = 12


def rope_views(folder: Path, width: int = 320, height: int = 240) -> list[View]:
    """Read the photographs, reduced to a size; depth is 0, not measured."""
    intrinsics, rotations, places = (np.load(folder / f"{name}_list.npy") for name in ("intr", "R", "t"))
    views = []
    for index in range(len(intrinsics)):
        rgb = cv2.cvtColor(cv2.imread(str(folder / f"img_{index}.png")), cv2.COLOR_BGR2RGB)
        mask = cv2.imread(str(folder / f"mask_{index}.png"), cv2.IMREAD_GRAYSCALE)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotations[index], places[index]
        camera = Camera(f"cam_{index}", rgb.shape[1], rgb.shape[0], intrinsics[index], pose).resized(width, height)
        small = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA)
        cover = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA)
        labels = np.where(cover > 127, MaskLabel.OBJECT, MaskLabel.BACKGROUND).astype(np.uint8)
        views.append(View(camera, small, np.zeros((height, width), np.float32), labels))
    return views


def rope_surface(folder: Path) -> Surface:
    """Read the cloud; normals are the least principal directions of neighbours, away from their middle."""
    table = read_vertices(folder / "pcd.ply")
    points = np.stack([table[name] for name in "xyz"], axis=-1).astype(np.float64)
    colours = np.stack([table[name] for name in ("red", "green", "blue")], axis=-1) / 255
    tree = cKDTree(points)
    near = points[tree.query(points, k=_NEIGHBOURS)[1]]
    normals = np.linalg.svd(near - near.mean(1, keepdims=True), full_matrices=False)[2][:, 2]
    # The middle of a neighbourhood as wide as the rope lies inside it.
    wide = points[tree.query(points, k=10 * _NEIGHBOURS)[1]].mean(1)
    return Surface(points, normals * np.sign(((points - wide) * normals).sum(1, keepdims=True) + 1e-12), colours)
