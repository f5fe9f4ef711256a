"""The silhouette of a triangle mesh in a camera, drawn finer than its pixels."""

from __future__ import annotations

import cv2
import numpy as np

from plop.geometry.cameras import Camera
from plop.geometry.rigid import transform_points
from plop.recordings.recording import Mesh

MANY_FACES = 1000
"""A mesh of more triangles is drawn as the convex outline of its vertices."""
FINER = 9
"""Odd, so that a pixel's centre is the centre of a finer pixel."""
INK = 127
"""Value of a drawn fine pixel: two of them fit into a byte."""


def outline(mesh: Mesh, world_from_tool: np.ndarray, camera: Camera) -> np.ndarray:
    """Draw the pixels whose centres a mesh covers, bool, shape [H, W].

    Triangles that reach behind the camera are left out. A mesh of more than MANY_FACES triangles is drawn as the
    convex outline of its vertices.
    """
    image = np.zeros((camera.height, camera.width), bool)
    drawn = _draw(mesh, world_from_tool, camera)
    if drawn is not None:
        fine, (left, top) = drawn
        part = fine[FINER // 2 :: FINER, FINER // 2 :: FINER]
        image[top : top + part.shape[0], left : left + part.shape[1]] = part
    return image


def coverage(mesh: Mesh, world_from_tool: np.ndarray, camera: Camera) -> np.ndarray:
    """Give the share of every pixel that a mesh covers, float32, shape [H, W]; `outline` says which meshes how."""
    image = np.zeros((camera.height, camera.width), np.float32)
    drawn = _draw(mesh, world_from_tool, camera)
    if drawn is not None:
        fine, (left, top) = drawn
        # OpenCV's lines cover half a fine pixel beyond an edge, measured along the image axis nearest to its normal.
        # A cross takes a whole one away, so that the mean of both is right on average.
        thin = cv2.erode(fine, cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
        height, width = fine.shape[0] // FINER, fine.shape[1] // FINER
        part = cv2.resize(fine + thin, (width, height), interpolation=cv2.INTER_AREA)
        image[top : top + height, left : left + width] = part / np.float32(2 * INK)
    return image


def _draw(mesh: Mesh, world_from_tool: np.ndarray, camera: Camera) -> tuple[np.ndarray, tuple[int, int]] | None:
    """Draw the part of the image that shows the mesh FINER times finer; gives it and its left upper pixel."""
    pixels, depth = camera.project(transform_points(world_from_tool, mesh.vertices))
    faces = mesh.faces[(depth[mesh.faces] > 1e-3).all(1)]
    if len(faces) == 0:
        return None
    used = pixels[np.unique(faces)]
    low = np.clip(np.floor(used.min(0)), 0, [camera.width, camera.height]).astype(int)
    high = np.clip(np.ceil(used.max(0)), low, [camera.width, camera.height]).astype(int)
    if (high <= low).any():
        return None
    # OpenCV also fills the pixels that an edge touches: drawn FINER times finer, that hardly widens the outline.
    fine = np.zeros(tuple((high - low)[::-1] * FINER), np.uint8)
    corners = (np.clip(pixels, -2 * camera.width, 3 * camera.width) - low) * FINER - 0.5
    shapes = list(corners[faces])
    if len(faces) > MANY_FACES:
        shapes = [cv2.convexHull(corners[np.unique(faces)].astype(np.float32))[:, 0]]
    for shape in shapes:
        cv2.fillConvexPoly(fine, np.round(shape * 16).astype(np.int32), INK, shift=4)
    return fine, (int(low[0]), int(low[1]))
