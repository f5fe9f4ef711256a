"""What can be wrong with a simulated episode although its files are whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import invert_rigid, transform_points
from plop.geometry.tool_reach import check_tool_reach
from plop.lazy_open3d import o3d
from plop.recordings.mesh_sequence import MeshSequence
from stages.ingest.untouched import untouched

_LARGEST_M, _SMALLEST_M = 2.0, 1e-3
_TOUCH_M = 0.003
_LONGEST_STEP_S = 2.0


def check_plausible(sequence: MeshSequence, path: Path, *, workspace_m: float) -> None:
    """Refuse an episode whose numbers are no metres and seconds, or whose parts do not belong together.

    Args:
        sequence: The episode.
        path: File that holds its arrays, for the messages; its JSON lies beside it.
        workspace_m: Farthest distance from the world's origin at which the object may start [m].

    Raises:
        PlopError: Size, place, clock, table or tool cannot be right; names file and key.
    """
    check_scale(sequence, workspace_m=workspace_m)
    check_clock(sequence, path)
    check_table(sequence, path.with_suffix(".json"))
    points = sequence.vertices.reshape(-1, 3)
    check_tool_reach(sequence.tool_vertices, sequence.world_from_tool, points, f"{path}: world_from_tool")


def check_clock(sequence: MeshSequence, path: Path) -> None:
    """Refuse a single frame, and frames so far apart that the times cannot be seconds.

    Raises:
        PlopError: Nothing can move, or the median step is too long (milliseconds?).
    """
    steps = np.diff(sequence.times)
    if not len(steps):
        raise PlopError("The episode is too short: nothing moves in it.", where=f"{path}: times",
                        expected="2 frames or more", found="1 frame",
                        fix="Record it again, or leave it out with --skip-bad.")  # fmt: skip
    if np.median(steps) > _LONGEST_STEP_S:
        raise PlopError("The frames are too far apart in time.", where=f"{path}: times",
                        expected=f"seconds, a median step of at most {_LONGEST_STEP_S:g} s",
                        found=f"a median step of {np.median(steps):.4g}: milliseconds?",
                        fix="Convert the times to seconds (milliseconds: divide by 1000).")  # fmt: skip


def check_table(sequence: MeshSequence, path: Path) -> None:
    """Refuse an object that starts wholly below its table, by more than its own size.

    Raises:
        PlopError: Names the table's height and the object's.
    """
    low, high = sequence.vertices[0].min(0), sequence.vertices[0].max(0)
    if sequence.table_z_m is not None and sequence.table_z_m - high[2] > (high - low).max():
        raise PlopError("The object lies far below its table.", where=f"{path}: table_z_m",
                        expected=f"an object on or above table_z_m = {sequence.table_z_m:g} m",
                        found=f"an object from z = {low[2]:.4g} to {high[2]:.4g} m in the first frame",
                        fix="Correct table_z_m (null: no table), or the frame of the vertices.")  # fmt: skip


def check_scale(sequence: MeshSequence, *, workspace_m: float) -> None:
    """Refuse an object that is no plausible size in metres or lies outside the workspace.

    Args:
        sequence: The episode.
        workspace_m: Farthest distance from the world's origin at which the object may start [m].

    Raises:
        PlopError: Too large (millimetres?), too small, blown up, or too far away.
    """
    for what, size in (("at rest", float(np.ptp(sequence.rest, axis=0).max())),
                       ("over time", float(np.ptp(sequence.vertices, axis=1).max()))):  # fmt: skip
        if size > _LARGEST_M or size < _SMALLEST_M:
            guess = "It looks like millimetres: divide by 1000." if size > _LARGEST_M else "Check the unit."
            raise PlopError("The object has an implausible size.", where=f"{sequence.name}, {what}",
                            expected=f"{_SMALLEST_M:g} to {_LARGEST_M:g} m", found=f"{size:.4g} m",
                            fix=guess)  # fmt: skip
    tool = float(np.ptp(sequence.tool_vertices, axis=0).max())
    if tool > _LARGEST_M or tool < _SMALLEST_M:
        raise PlopError("The tool has an implausible size.", where=sequence.name, fix="Convert it to metres.",
                        expected=f"{_SMALLEST_M:g} to {_LARGEST_M:g} m", found=f"{tool:.4g} m")  # fmt: skip
    middle = (sequence.vertices[0].min(0) + sequence.vertices[0].max(0)) / 2
    if np.linalg.norm(middle) > workspace_m:
        raise PlopError("The object lies outside the workspace.", where=sequence.name,
                        expected=f"within {workspace_m:g} m of the world's origin",
                        found=f"middle at {np.round(middle, 3).tolist()} m",
                        fix="Check the frame and the unit, or raise workspace_m.")  # fmt: skip


def tool_gap_m(sequence: MeshSequence) -> float:
    """Measure how close the tool ever comes to the object's surface [m], to about 2 mm."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(sequence.tool_vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(sequence.tool_faces.astype(np.uint32)),
    )
    best = np.inf
    for vertices, world_from_tool in zip(sequence.vertices, sequence.world_from_tool, strict=True):
        corner = vertices[sequence.faces]
        points = np.concatenate([vertices, corner.mean(1), (corner + np.roll(corner, 1, axis=1)).reshape(-1, 3) / 2])
        local = transform_points(invert_rigid(world_from_tool), points).astype(np.float32)
        best = min(best, float(scene.compute_distance(o3d.core.Tensor.from_numpy(local)).numpy().min()))
    return best


def check_contact(sequence: MeshSequence, path: Path) -> None:
    """Refuse an episode in which the tool never touches the object: no model learns contact from it.

    Raises:
        PlopError: The tool stays away; names file, key and the smallest distance.
    """
    gap = tool_gap_m(sequence)
    if gap > _TOUCH_M:
        raise untouched(f"{path}: world_from_tool", _TOUCH_M, f"{sequence.name}, {1000 * gap:.1f} mm at its nearest",
                        "Correct the tool's poses or mesh")  # fmt: skip
