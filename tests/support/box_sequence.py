"""A box that is cut in two and pulled apart, as a mesh sequence, for tests of rendering and ingest."""

from __future__ import annotations

import numpy as np

from plop.recordings.readers.mesh.sequence import MeshSequence
from tests.support.box import BOX_FACES

_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
_FACES = BOX_FACES
BLADE = np.array(
    [[-0.003, -0.06, 0], [0.003, -0.06, 0], [0, -0.06, -0.03], [-0.003, 0.06, 0], [0.003, 0.06, 0], [0, 0.06, -0.03]]
)
BLADE_FACES = np.array([[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]])
BLADE_FACES = BLADE_FACES[:, ::-1]


def box_sequence(
    name: str = "box_000", *, frames: int = 3, gap_m: float = 0.02, height_m: float = 0.03, environment: str = "box"
) -> MeshSequence:
    """Give a 60 x 60 mm box on the table at z = 0, cut at x = 0; the right half moves along x."""
    halves = [_CORNERS * [0.03, 0.06, height_m] - [0.03, 0.03, 0], _CORNERS * [0.03, 0.06, height_m] - [0, 0.03, 0]]
    rest = np.concatenate(halves)
    vertices = np.tile(rest, (frames, 1, 1))
    vertices[:, 8:, 0] += np.linspace(0, gap_m, frames)[:, None]
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 2, 3] = np.linspace(height_m + 0.04, 0.03, frames)
    faces = np.concatenate([_FACES, _FACES + 8])
    cut = np.zeros(len(faces), bool)
    cut[[2, 3, 12, 13]] = True
    return MeshSequence(
        name=name,
        environment=environment,
        times=np.arange(frames) * 0.05,
        vertices=vertices,
        faces=faces,
        tool_vertices=BLADE,
        tool_faces=BLADE_FACES,
        world_from_tool=poses,
        rest_vertices=rest,
        cut_faces=cut,
        truth={"nodes_m": vertices.astype(np.float32)},
        facts={"youngs_modulus_pa": 1e4},
    )
