"""Blender is asked for the right thing; with PLOP_BLENDER set it is really asked."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from plop.errors import PlopError
from plop.render.virtual_cameras.blender import BlenderRenderer, blender_command, subdivided
from plop.render.virtual_cameras.mesh_raycast import Look, MeshRenderer
from plop.render.virtual_cameras.texture import SolidTexture
from tests.render.test_mesh_raycast import camera_aslant
from tests.support.box_sequence import box_sequence

LOOK = Look(SolidTexture.from_seed(3))


def test_without_blender_the_message_says_how_to_get_it() -> None:
    with pytest.raises(PlopError, match="Blender is not found") as caught:
        blender_command("no-such-blender", Path("scene.npz"), Path("out"))
    assert "pip install bpy" in caught.value.fix and "raycast" in caught.value.fix


def test_command_for_blender_and_for_a_python_with_bpy(tmp_path: Path) -> None:
    blender = tmp_path / "blender"
    blender.write_text("#!/bin/sh\n")
    blender.chmod(0o755)
    command = blender_command(str(blender), Path("s.npz"), Path("out"))
    assert command[1:4] == ["--background", "--factory-startup", "--python"] and command[-3:] == ["--", "s.npz", "out"]
    assert Path(command[4]).is_file(), "the script ships with plop"
    assert blender_command(sys.executable, Path("s.npz"), Path("out"))[1] == command[4]


def test_a_failing_blender_is_reported_with_its_last_words(tmp_path: Path) -> None:
    broken = tmp_path / "blender"
    broken.write_text("#!/bin/sh\necho 'no device' >&2\nexit 3\n")
    broken.chmod(0o755)
    with pytest.raises(PlopError, match="Blender failed") as caught:
        BlenderRenderer(box_sequence(), LOOK, [camera_aslant()], executable=str(broken))
    assert "no device" in caught.value.found and "exit code 3" in caught.value.found


def test_subdividing_keeps_the_surface() -> None:
    sequence = box_sequence(gap_m=0.0)
    vertices, faces, colours = subdivided(sequence, LOOK, 4)
    assert len(faces) == 16 * len(sequence.faces) and len(colours) == vertices.shape[1]

    def area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        corner = points[triangles]
        return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]).sum(0)

    for part in (slice(0, 12), slice(12, 24)):
        small = slice(part.start * 16, part.stop * 16)
        np.testing.assert_allclose(
            area(vertices[1], faces[small]), area(sequence.vertices[1], sequence.faces[part]), atol=1e-8
        )
    box = np.abs(vertices[0] - [0, 0, 0.015]) - [0.03, 0.03, 0.015]
    assert box.max() < 1e-6


@pytest.mark.skipif("PLOP_BLENDER" not in os.environ, reason="PLOP_BLENDER names no Blender")
def test_blender_draws_the_same_scene_from_the_same_place() -> None:
    sequence, camera = box_sequence(frames=2), camera_aslant(64)
    exact = MeshRenderer(sequence, LOOK)
    with BlenderRenderer(sequence, LOOK, [camera], executable=os.environ["PLOP_BLENDER"], samples=8) as blender:
        for frame in range(2):
            view = exact.render(frame, camera)
            drawn = blender.recolour(view, frame)
            body = view.mask == 1
            agree = np.corrcoef(view.rgb[body].ravel().astype(float), drawn.rgb[body].ravel().astype(float))[0, 1]
            assert agree > 0.85
