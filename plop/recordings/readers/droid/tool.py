"""The tool of a DROID episode: a mesh file in metres, or a substitute for a closed gripper."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from plop.errors import PlopError
from plop.geometry.meshes.tool_checks import check_tool_mesh
from plop.recordings.recording import Mesh

LARGEST_M = 1.0
"""Largest length of a tool; larger values are taken as millimetres [m]."""
_LEAST_USED = 0.98
"""Smallest share of an OBJ file's vertices that its faces use; vertices come first in the file."""
FINGERS_M = (0.03, 0.03, 0.16)
"""Substitute when no mesh is given: the closed fingers of a gripper, from the flange along its z axis [m]."""


def tool_mesh(path: Path | None, episode: str) -> tuple[Mesh, list[str]]:
    """Read the tool.

    Args:
        path: STL, OBJ or PLY in the tool's frame, metres; None for the substitute.
        episode: Name for messages.

    Returns:
        The mesh and warnings.

    Raises:
        PlopError: The file is truncated or damaged, contains no triangles, or is in millimetres.
    """
    if path is None:
        box = trimesh.creation.box(FINGERS_M)
        vertices = np.asarray(box.vertices, dtype=np.float64) + [0, 0, FINGERS_M[2] / 2]
        return Mesh(vertices, np.asarray(box.faces, dtype=np.int64)), [
            f"{episode}: plop_episode.json names no tool; a box of {1000 * FINGERS_M[0]:.0f} x "
            f"{1000 * FINGERS_M[1]:.0f} x {1000 * FINGERS_M[2]:.0f} mm at the flange represents closed fingers"
        ]
    _check_whole(path)
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
    notes = check_tool_mesh(vertices, faces, str(path))
    return Mesh(vertices, faces), [f"{episode}: {path.name}: {note}" for note in notes]


def _check_whole(path: Path) -> None:
    """Reject a truncated file or one with zeros in place of text, as far as its format allows."""
    content, kind = path.read_bytes(), path.suffix.lower()
    counted = int.from_bytes(content[80:84], "little")
    text = kind == ".obj" or (kind == ".stl" and content[:5] == b"solid" and len(content) != 84 + 50 * counted)
    if not content.strip(b"\0"):
        raise _cut_off(path, "a mesh", f"{len(content)} bytes, all zero" if content else "an empty file")
    if kind == ".stl" and not text and counted and 84 <= len(content) < 84 + 50 * counted:
        raise _cut_off(
            path,
            f"{84 + 50 * counted} bytes for the {counted} triangles that its header counts",
            f"{len(content)} bytes",
        )
    if text and b"\0" in content:
        raise _cut_off(path, "text", f"{content.count(0)} bytes that are zero, the first at {content.index(0)}")
    if kind == ".stl" and text and b"endsolid" not in content[-200:]:
        raise _cut_off(path, "a file that ends with endsolid", f"{content[-20:]!r}")
    if kind == ".obj":
        _check_obj_used(path, content)


def _check_obj_used(path: Path, content: bytes) -> None:
    words = [line.split() for line in content.splitlines()]
    count = sum(line[:1] == [b"v"] for line in words)
    used = {word.split(b"/")[0] for line in words if line[:1] in ([b"f"], [b"l"], [b"p"]) for word in line[1:]}
    if count and len(used) < _LEAST_USED * count:
        raise _cut_off(path, f"faces for its {count} vertices", f"faces for {len(used)} of them")


def _cut_off(path: Path, expected: str, found: str) -> PlopError:
    return PlopError(
        "The tool's mesh is damaged.",
        where=path,
        expected=expected,
        found=found,
        fix="The file is truncated or part of it was lost: copy or export it again.",
    )


def _bad(path: Path, expected: str, found: str) -> PlopError:
    return PlopError(
        "The tool's mesh is not usable.",
        where=path,
        expected=expected,
        found=found,
        fix="Export the tool in metres as STL, OBJ or PLY.",
    )
