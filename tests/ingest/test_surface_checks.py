"""What is checked of a simulated surface: order of its vertices, its up axis, the sides of its faces."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh

from plop.errors import PlopError
from plop.recordings.readers.declared_units import WORLD_FROM_UP
from plop.recordings.readers.mesh.sequence import MeshSequence
from stages.ingest.resting import check_table
from stages.ingest.surface_checks import check_order, sound_surface
from tests.ingest.simulated_runs import BOX


def _soft_block() -> MeshSequence:
    """A fine block that is pressed and falls in two parts, one of which is thrown aside from one frame to the next."""
    ball = trimesh.creation.icosphere(2, radius=0.03)
    rest = np.asarray(ball.vertices) + [0, 0, 0.03]
    vertices = np.stack(
        [np.concatenate([rest * [1 + 0.1 * k, 1, 1 - 0.1 * k], rest + [0.08 + 0.05 * (k > 2), 0, 0]]) for k in range(6)]
    )
    faces = np.concatenate([ball.faces, ball.faces + len(rest)])
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 2, 3] = np.linspace(0.08, 0.06, 6)
    return dataclasses.replace(
        BOX,
        times=np.arange(6) / 30,
        vertices=vertices,
        faces=faces,
        world_from_tool=poses,
        rest_vertices=vertices[0],
        cut_faces=None,
        truth={},
    )


def test_vertices_that_change_their_order_are_told_from_fast_motion() -> None:
    block, rng = _soft_block(), np.random.default_rng(0)
    assert check_order(block, Path("e.npz")) == []
    turns = np.arange(6) * np.pi / 2
    spun = np.stack(
        [
            frame @ [[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]
            for frame, a in zip(block.vertices, turns, strict=True)
        ]
    )
    assert check_order(dataclasses.replace(block, vertices=spun), Path("e.npz")) == []
    count = block.vertices.shape[1]
    for change, frame in ((rng.permutation(count), 4), (np.roll(np.arange(count), 1), 2)):
        vertices = block.vertices.copy()
        vertices[frame:] = vertices[frame:][:, change]
        with pytest.raises(PlopError, match="order of the vertices changes") as caught:
            check_order(dataclasses.replace(block, vertices=vertices), Path("e.npz"))
        assert str(caught.value.where).endswith(f"frame {frame}")
    swapped = block.vertices.copy()
    swapped[1:, [3, 90]] = swapped[1:, [90, 3]]
    with pytest.raises(PlopError, match="order of the vertices changes"):
        check_order(dataclasses.replace(block, vertices=swapped), Path("e.npz"))
    with pytest.raises(PlopError, match="not in the same order"):
        check_order(dataclasses.replace(block, rest_vertices=block.rest[rng.permutation(count)]), Path("e.npz"))


@pytest.mark.parametrize("up", ["x", "y", "-y", "-z"])
@pytest.mark.parametrize("place", [(0, 0), (0.11, -0.07)])
def test_each_wrong_up_axis_is_told_with_the_right_one(up: str, place: tuple[float, float]) -> None:
    turn = WORLD_FROM_UP[up].T
    turned = dataclasses.replace(BOX, vertices=(BOX.vertices + [*place, 0]) @ turn.T, rest_vertices=None)
    with pytest.raises(PlopError, match="up axis seems to be wrong") as caught:
        check_table(turned, Path("e.json"))
    assert f'"up": "{up}"' in str(caught.value.fix)


def test_a_hollow_keeps_its_inner_side_when_its_body_is_turned() -> None:
    outer, inner = trimesh.creation.box([0.06, 0.06, 0.06]), trimesh.creation.box([0.02, 0.02, 0.02])
    corners = np.concatenate([outer.vertices, inner.vertices]) + [0, 0, 0.03]
    faces = np.concatenate([outer.faces, np.asarray(inner.faces)[:, ::-1] + len(outer.vertices)])
    vertices = np.tile(corners, (3, 1, 1))
    hollow = dataclasses.replace(BOX, vertices=vertices, faces=faces, rest_vertices=None, cut_faces=None, truth={})
    assert sound_surface(hollow, Path("e.npz")) == (hollow, [])
    mended, notes = sound_surface(dataclasses.replace(hollow, faces=faces[:, ::-1]), Path("e.npz"))
    np.testing.assert_array_equal(mended.faces, faces)
    assert len(notes) == 1 and "were flipped" in notes[0]
