"""The tool of a DROID episode: a mesh file in metres, or a stand-in for a closed gripper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from plop.errors import PlopError
from plop.recordings.recording import Mesh

LARGEST_M = 1.0
"""A tool longer than this is taken for millimetres [m]."""
FINGERS_M = (0.03, 0.03, 0.16)
"""Stand-in when no mesh is given: the closed fingers of a gripper, from the flange along its z axis [m]."""


def tool_mesh(path: Path | None, episode: str) -> tuple[Mesh, list[str]]:
    """Read the tool.

    Args:
        path: STL, OBJ or PLY in the tool's frame, metres; None for the stand-in.
        episode: Name for messages.

    Returns:
        The mesh and warnings.

    Raises:
        PlopError: The file holds no triangles, or is in millimetres.
    """
    if path is None:
        box = trimesh.creation.box(FINGERS_M)
        vertices = np.asarray(box.vertices, dtype=np.float64) + [0, 0, FINGERS_M[2] / 2]
        return Mesh(vertices, np.asarray(box.faces, dtype=np.int64)), [
            f"{episode}: plop_episode.json names no tool; a box of {1000 * FINGERS_M[0]:.0f} x "
            f"{1000 * FINGERS_M[1]:.0f} x {1000 * FINGERS_M[2]:.0f} mm at the flange stands in for closed fingers"
        ]
    try:
        loaded = trimesh.load(path, force="mesh", process=True)
    except Exception as error:  # trimesh raises whatever its file readers raise
        raise _bad(path, "a mesh file", str(error) or type(error).__name__) from error
    vertices, faces = getattr(loaded, "vertices", np.zeros((0, 3))), getattr(loaded, "faces", np.zeros((0, 3)))
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    if len(faces) < 4 or not np.isfinite(vertices).all():
        raise _bad(path, "triangles with finite corners", f"{len(vertices)} vertices, {len(faces)} triangles")
    longest = float(np.ptp(vertices, axis=0).max())
    if longest > LARGEST_M:
        raise _bad(path, f"a tool in metres, at most {LARGEST_M:g} long", f"{longest:.1f}: millimetres?")
    if longest < 0.005:
        raise _bad(path, "a tool in metres, at least 0.005 long", f"{longest:.6f}")
    return Mesh(vertices, faces), []


def _bad(path: Path, expected: str, found: str) -> PlopError:
    return PlopError("The tool's mesh cannot be used.", where=path, expected=expected, found=found,
                     fix="Export the tool in metres as STL, OBJ or PLY.")  # fmt: skip
