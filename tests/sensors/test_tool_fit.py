"""The drawn tool against depth: right axes are kept, others named, and a table is no tool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.geometry.view import View
from plop.sensors.checks.tool_fit import THROUGH, ToolLook, all_axes
from tests.support.droid_scene import TABLE_Z, Scene, exterior_poses, flange_path, knife, world_from_tool

POSE = world_from_tool(flange_path(2, high=0.2))[0]


@pytest.fixture(scope="module")
def frames():
    scene = Scene(160, 120, 140.0)
    views = [View(scene.camera(pose), *scene.render(pose, POSE)) for pose in exterior_poses().values()]
    return [([view], [POSE]) for view in views]


def test_axes_are_all_different_and_named():
    axes = list(all_axes())
    assert len({each.matrix.tobytes() for each in axes}) == 47
    assert sum(np.linalg.det(each.matrix) > 0 for each in axes) == 23
    assert all(np.allclose(each.matrix @ each.matrix.T, np.eye(3)) for each in axes)


def test_the_right_mesh_is_measured_and_kept(frames):
    look = ToolLook(knife(), TABLE_Z)
    for views, poses in frames:
        fit = look.fit(views, poses)
        assert fit.through is not None and fit.through < 0.05
    assert look.better_axes(frames) is None


@pytest.mark.parametrize(
    ("matrix", "name"),
    [
        ([[1, 0, 0], [0, 0, 1], [0, -1, 0]], "about x"),
        ([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], "about y"),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "about z"),
    ],
)
def test_other_axes_are_named(frames, matrix, name):
    mesh = replace(knife(), vertices=knife().vertices @ np.array(matrix, float).T)
    found = ToolLook(mesh, TABLE_Z).better_axes(frames)
    assert found is not None and name in found.name
    fixed = replace(mesh, vertices=mesh.vertices @ found.matrix.T)
    assert np.allclose(np.ptp(fixed.vertices, axis=0), np.ptp(knife().vertices, axis=0))


def test_a_mount_that_is_off_is_measured(frames):
    mesh = replace(knife(), vertices=knife().vertices + [0.0, 0.045, 0.0])
    look = ToolLook(mesh, TABLE_Z)
    assert look.fit(*frames[0]).through > THROUGH
    found = look.better_place(frames)
    assert found is not None and found[1] == pytest.approx(-0.045, abs=0.015)


def test_a_tool_on_the_table_proves_nothing(frames):
    flat = np.eye(4)
    flat[:3, 3] = [0.35, 0.0, TABLE_Z]
    fit = ToolLook(knife(), TABLE_Z).fit(frames[0][0], [flat])
    assert fit.measured_px == 0
