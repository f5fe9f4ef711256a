"""How much of each pixel a mesh covers, against the exact area of its outline."""

from __future__ import annotations

import cv2
import numpy as np

from plop.geometry.cameras import Camera, look_at
from plop.physics.scenes.demo import blade_mesh
from plop.recordings.recording import Mesh
from plop.sensors.silhouette import coverage, outline


def test_coverage_has_the_area_of_the_outline():
    mesh, wrong = Mesh(*blade_mesh()), []
    matrix = np.array([[203.0, 0, 128], [0, 203, 128], [0, 0, 1]])
    for turn in range(20):
        eye = 0.37 * np.array([np.cos(turn), np.sin(turn), 0.7])
        camera = Camera("a", 256, 256, matrix, look_at(eye, np.zeros(3), np.array([0, 0, 1.0])))
        hull = cv2.convexHull(camera.project(mesh.vertices)[0].astype(np.float32))
        covered = coverage(mesh, np.eye(4), camera)
        wrong.append((covered.sum() - cv2.contourArea(hull)) / cv2.arcLength(hull, True))
        assert np.abs((covered > 0.5) ^ outline(mesh, np.eye(4), camera)).mean() < 0.002
    assert abs(np.mean(wrong)) < 0.01 and np.abs(wrong).max() < 0.05
