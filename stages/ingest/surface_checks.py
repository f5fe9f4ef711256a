"""Checks of the surface of a simulated object over time: constant vertex order, no lost data, outward faces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.geometry.meshes.mesh_topology import Topology, is_collapsed, volumes, welded
from plop.geometry.meshes.tool_checks import check_tool_mesh
from plop.recordings.readers.mesh.sequence import MeshSequence

_LEAPS, _ONTO, _BENT = 0.5, 0.2, 0.3
"""A vertex changes its index if it jumps by half an edge or more relative to its neighbours, lands five times closer to
the previous position of another one (or as close as the others have moved), is replaced by another one, and has an edge
that changes by 30 %. Rigid motions keep edges; in 114 recordings of two simulators an edge changes by at most 23 % in
one frame."""
_MISPLACED_SHARE = 0.5
"""Smallest share of the jumping vertices that do so: by chance one in ten lands so close."""
_STRETCH, _FAR = 3.0, 0.25
"""An edge is torn if it becomes three times as long and longer by a quarter of the object's size in one frame."""
_TORN_SHARE = 0.02
"""Share of torn edges above which the surface is different, not only torn between two halves."""
_SAMPLED = 5


def sound_surface(sequence: MeshSequence, path: Path) -> tuple[MeshSequence, list[str]]:
    """Check the surfaces of object and tool, and flip the object's faces so that they point outwards.

    Args:
        sequence: The episode.
        path: File that holds its arrays.

    Returns:
        The episode, with flipped faces where that is certain, and notes.

    Raises:
        PlopError: Vertices change their order, parts of the surface or the tool are lost.
    """
    notes = check_order(sequence, path)
    sequence, more = _outwards(sequence)
    tool = check_tool_mesh(sequence.tool_vertices, sequence.tool_faces, f"{path}: tool_vertices, tool_faces")
    return sequence, notes + more + [f"tool: {note}" for note in tool]


def check_order(sequence: MeshSequence, path: Path) -> list[str]:
    """Reject vertices that change their index from one frame to the next, or suddenly coincide.

    Returns:
        Notes on single edges that tear.

    Raises:
        PlopError: Names the first frame.
    """
    edges = np.unique(np.sort(sequence.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]
    if not len(edges):
        raise _lost(path, "every face is collapsed", 0)
    size = float(np.ptp(sequence.vertices[0], axis=0).max())
    rest = _lengths(sequence.rest, edges)
    _check_rest(sequence, edges, rest, path)
    before, notes = _lengths(sequence.vertices[0], edges), list[str]()
    longest = np.maximum(rest, before)
    for frame in range(len(sequence)):
        now = _lengths(sequence.vertices[frame], edges)
        _check_lost(sequence, edges, now, longest, frame, path)
        if frame:
            torn = (now - before > _FAR * size) & (now > _STRETCH * np.maximum(before, np.median(before)))
            if _swapped(sequence, frame, edges, before, now):
                raise _reordered(
                    path,
                    frame,
                    "The order of the vertices changes over time.",
                    "vertices jump to positions of other ones",
                )
            if torn.mean() > _TORN_SHARE:
                raise _reordered(
                    path,
                    frame,
                    "The surface is torn between two frames.",
                    f"{int(torn.sum())} of {len(edges)} edges become over {_STRETCH:g} times as long",
                )
            if torn.any() and not notes:
                notes.append(
                    f"{int(torn.sum())} of {len(edges)} edges of the surface become over {_STRETCH:g} times "
                    f"as long from frame {frame - 1} to {frame}: did the simulation diverge?"
                )
        before, longest = now, np.maximum(longest, now)
    return notes


def _lengths(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1))


def _swapped(sequence: MeshSequence, frame: int, edges: np.ndarray, before: np.ndarray, now: np.ndarray) -> bool:
    """Return whether vertices swap positions in this frame: the set barely moves, but its members jump."""
    old, new = sequence.vertices[frame - 1], sequence.vertices[frame]
    move = new - old
    leap = np.linalg.norm(move, axis=1)
    typical = float(np.median(before))
    leaps = _against_neighbours(move, edges) > _LEAPS * typical
    if leaps.sum() < 2:
        return False
    bent = np.abs(now - before) > _BENT * np.maximum(before, typical)
    touched = np.zeros(len(old), bool)
    touched[edges[bent]] = True
    suspects = np.flatnonzero(leaps & touched)
    if len(suspects) < max(2, _MISPLACED_SHARE * leaps.sum()):
        return False
    nearest = np.maximum(cKDTree(old).query(new[suspects])[0], cKDTree(new).query(old[suspects])[0])
    drift = float(np.median(leap[~leaps])) if (~leaps).any() else 0.0
    onto = np.maximum(_ONTO * leap[suspects], np.minimum(2 * drift, leap[suspects] / 2))
    return bool((nearest < onto).sum() >= max(2, _MISPLACED_SHARE * leaps.sum()))


def _against_neighbours(move: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the motion of each vertex relative to its neighbours, their upper median, [V]; 0 where there are none."""
    ends = np.concatenate([edges, edges[:, ::-1]])
    apart = np.linalg.norm(move[ends[:, 0]] - move[ends[:, 1]], axis=1)
    order = np.lexsort((apart, ends[:, 0]))
    count = np.bincount(ends[:, 0], minlength=len(move))
    middle = np.minimum(np.cumsum(count) - count + count // 2, len(ends) - 1)
    return np.where(count > 0, apart[order][middle], 0)


def _check_rest(sequence: MeshSequence, edges: np.ndarray, rest: np.ndarray, path: Path) -> None:
    """Reject rest vertices in another order than the vertices, by their edges, independent of the rest pose."""
    if sequence.rest_vertices is None:
        return
    first = _lengths(sequence.vertices[0], edges)
    typical = max(float(np.median(rest)), 1e-9)
    changed = (np.abs(first - rest) > 0.5 * np.maximum(rest, typical)).mean()
    size, spread = (float(np.ptp(points, axis=0).max()) for points in (sequence.rest, sequence.vertices[0]))
    if changed > 0.25 and np.sort(first)[-1] < 2 * max(size, spread) and 0.5 < size / spread < 2:
        raise PlopError(
            "rest_vertices and vertices are not in the same order.",
            where=f"{path}: rest_vertices",
            expected="the rest position of each vertex, in the order of vertices",
            found=f"{100 * changed:.0f} % of the edges differ by half or more from the first frame",
            fix="Export both with one order, or leave rest_vertices out.",
        )


def _check_lost(
    sequence: MeshSequence, edges: np.ndarray, now: np.ndarray, longest: np.ndarray, frame: int, path: Path
) -> None:
    """Reject a frame in which neighbouring vertices coincide exactly although they were or are separate."""
    gone = (now == 0) & (longest > 0)
    at_zero = (sequence.vertices[frame] == 0).all(1)
    moved = at_zero & ~(sequence.vertices[max(frame - 1, 0)] == 0).all(1) & ~(sequence.rest == 0).all(1)
    if gone.sum() >= 3 or moved.sum() >= 2:
        place = sequence.vertices[frame][edges[int(np.argmax(gone)), 0]] if gone.any() else np.zeros(3)
        raise _lost(
            path,
            f"{int(max(gone.sum(), moved.sum()))} neighbours or more at ({place[0]:g} {place[1]:g} {place[2]:g})",
            frame,
        )


def _lost(path: Path, found: str, frame: int) -> PlopError:
    return PlopError(
        "Vertices of the surface coincide.",
        where=f"{path}: vertices, frame {frame}",
        expected="every vertex at a distinct position",
        found=found,
        fix="Part of the data was lost or set to zero: export the episode again.",
    )


def _reordered(path: Path, frame: int, problem: str, found: str) -> PlopError:
    return PlopError(
        problem,
        where=f"{path}: vertices, frame {frame}",
        expected="vertex i is the same point of the material in all frames",
        found=f"from frame {frame - 1} to {frame} {found}",
        fix="Export without merging or sorting vertices (trimesh: process=False; Blender: keep vertex "
        "order), one numbering for all frames.",
    )


def _outwards(sequence: MeshSequence) -> tuple[MeshSequence, list[str]]:
    """Flip faces so that neighbours agree and closed parts have a positive volume; note open or collapsed parts."""
    frames = np.unique(np.linspace(0, len(sequence) - 1, _SAMPLED).astype(int))
    joined = welded(np.concatenate([sequence.rest[None], sequence.vertices[frames]]), sequence.faces)
    collapsed = is_collapsed(joined)
    notes = []
    if collapsed.any():
        notes.append(f"{int(collapsed.sum())} of {len(collapsed)} faces of the surface are collapsed")
    if collapsed.all():
        return sequence, notes
    topology = Topology.of(joined[~collapsed])
    if not topology.orientable:
        return sequence, [*notes, "the faces of the surface cannot be oriented consistently"]
    turned = topology.turned.copy()
    if not topology.is_closed:
        crowded = f", {topology.crowded_edges} with more than two" if topology.crowded_edges else ""
        notes.append(
            f"the surface is not closed ({topology.free_edges} edges with one face{crowded}): scores that "
            "need the inside or the volume of the truth are not valid for it"
        )
    outer = sequence.faces[~collapsed].copy()
    outer[turned] = outer[turned][:, ::-1]
    if topology.is_closed:
        inside_out = _inside_out(sequence.vertices[0], outer, topology.piece)
        turned = turned ^ inside_out[topology.piece]
    if not turned.any():
        return sequence, notes
    faces = sequence.faces.copy()
    which = np.flatnonzero(~collapsed)[turned]
    faces[which] = faces[which][:, ::-1]
    notes.append(
        f"{len(which)} of {len(faces)} faces were clockwise seen from outside, or inconsistent with their neighbours, "
        "and were flipped"
    )
    return replace(sequence, faces=faces), notes


def _inside_out(vertices: np.ndarray, faces: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Return which parts are inside out, bool, shape [P]: those inside no other part, with a negative volume.

    A part within another one (a hollow, a stone) may have either orientation, and is flipped with the outer one.
    """
    volume = volumes(vertices, faces, piece)
    count = len(volume)
    boxes = [vertices[faces[piece == number]].reshape(-1, 3) for number in range(count)]
    low, high = (np.array([getattr(box, end)(0) for box in boxes]) for end in ("min", "max"))
    inside = np.asarray(((low[:, None] > low[None]) & (high[:, None] < high[None])).all(-1))
    out: np.ndarray = np.zeros(count, bool)
    for number in range(count):
        around = np.flatnonzero(inside[number])
        outermost = around[np.argmax(np.prod(high[around] - low[around], axis=1))] if len(around) else number
        out[number] = volume[outermost] < 0
    return out
