"""Check that the object lies on its table, and if not, whether it would with another up axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import transform_points
from plop.recordings.readers.declared_units import WORLD_FROM_UP
from plop.recordings.readers.mesh.sequence import MeshSequence

_CONTACT_M, _CONTACT_SHARE = 0.003, 0.05
"""Largest depth in or height above its table of an object on it: 3 mm and 5 % of its height. Soft bodies penetrate
a simulated table by 1 to 2 mm; 114 recordings of two simulators start within 0.1 mm."""
_TOOL_DEEPER_M = 0.02
"""Depth of a tool below the table that is noted: in a simulator it cuts through, DiSECt's by 8 mm [m]."""
_FALLS_M = 1e-3
"""Smallest sinking of the centre of a falling object above its table [m]."""


def check_table(sequence: MeshSequence, path: Path) -> list[str]:
    """Reject an object that starts in its table, or that would be on it only with another up axis.

    Args:
        sequence: The episode.
        path: The JSON file, for messages.

    Returns:
        Notes: an object that stays above its table, one that sinks into it later, a tool deep below it.

    Raises:
        PlopError: Names heights and, if there is one, the correct axis.
    """
    height = sequence.table_z_m
    if height is None:
        return []
    first = sequence.vertices[0]
    allowed = _allowed_m(first)
    gap = float(first[:, 2].min()) - height
    falling = gap > allowed and float((sequence.vertices[0] - sequence.vertices[-1])[:, 2].mean()) > _FALLS_M
    if abs(gap) <= allowed or falling:
        return _tool_below(sequence, path, height) + _sinks_later(sequence, height)
    axis = _better_axis(sequence, height)
    what = f"an object from z = {first[:, 2].min():.4g} to {first[:, 2].max():.4g} m in the first frame"
    on_table = f"an object on table_z_m = {height:g} m"
    if axis and not (gap > 0 and "up" in sequence.declared):
        raise PlopError(
            "The object is not on its table: the up axis seems to be wrong.",
            where=f"{path}: table_z_m",
            expected=f"{on_table}, {sequence.up} up",
            found=what,
            fix=f"With {axis} up it is on the table: {_turn(sequence.up, axis)}. Declare it in "
            f'{path.name}: "units": {{"up": "{axis}"}}, or rotate vertices and poses; if the axes are '
            "right, correct table_z_m (null: no table).",
        )
    if gap < 0:
        below = "far below" if height > first[:, 2].max() else "partly in"
        raise PlopError(
            f"The object is {below} its table.",
            where=f"{path}: table_z_m",
            expected=on_table,
            found=f"{what}: {1000 * -gap:.3g} mm too low",
            fix="Correct table_z_m (null: no table), or the frame of the vertices.",
        )
    return [
        f"the object floats {1000 * gap:.3g} mm above its table and does not fall: is table_z_m = {height:g} "
        "right? (null: no table)"
    ]


def _allowed_m(points: np.ndarray) -> float:
    return _CONTACT_M + _CONTACT_SHARE * float(np.ptp(points[:, 2]))


def _better_axis(sequence: MeshSequence, height: float) -> str | None:
    """Find the up axis with which the object is on the table; the flattest contact wins."""
    fitting = {}
    for axis, turn in WORLD_FROM_UP.items():
        points = sequence.vertices[0] @ (turn @ WORLD_FROM_UP[sequence.up].T).T
        gap = float(points[:, 2].min()) - height
        if axis != sequence.up and abs(gap) <= _allowed_m(points):
            fitting[axis] = (-float((points[:, 2] - height < _CONTACT_M).mean()), abs(gap), axis.startswith("-"))
    return min(fitting, key=lambda axis: fitting[axis]) if fitting else None


def _turn(read: str, axis: str) -> str:
    """Describe the change of coordinates when `axis` instead of `read` is up, e.g. (x, y, z) -> (x, -z, y)."""
    rows = np.round(WORLD_FROM_UP[read].T @ WORLD_FROM_UP[axis]).astype(int)
    names = [("-" if row.min() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in rows]
    return f"(x, y, z) -> ({', '.join(names)})"


def _sinks_later(sequence: MeshSequence, height: float) -> list[str]:
    lows = sequence.vertices[..., 2].min(1) - height
    if lows.min() >= -_allowed_m(sequence.vertices[0]):
        return []
    return [f"the object sinks {-1000 * lows.min():.3g} mm into its table, deepest in frame {int(np.argmin(lows))}"]


def _tool_below(sequence: MeshSequence, path: Path, height: float) -> list[str]:
    """Note a tool deep in the table; reject it if another up axis, also consistent with the object, avoids this."""
    deep = height - _lowest_tool(sequence, np.eye(3))
    if deep <= _TOOL_DEEPER_M:
        return []
    axis = _better_axis(sequence, height)
    turn = WORLD_FROM_UP[axis] @ WORLD_FROM_UP[sequence.up].T if axis else np.eye(3)
    if axis and "up" not in sequence.declared and height - _lowest_tool(sequence, turn) < _CONTACT_M:
        raise PlopError(
            "The tool is deep in the table: the up axis seems to be wrong.",
            where=f"{path}: table_z_m",
            expected=f"a tool above table_z_m = {height:g} m, {sequence.up} up",
            found=f"a tool {1000 * deep:.3g} mm below it",
            fix=f"With {axis} up it stays above: {_turn(sequence.up, axis)}. Declare the axis in "
            f'{path.name}: "units": {{"up": "{axis}"}}, or rotate vertices and poses.',
        )
    return [f"the tool goes {1000 * deep:.3g} mm below the table"]


def _lowest_tool(sequence: MeshSequence, turn: np.ndarray) -> float:
    return min(
        float((transform_points(pose, sequence.tool_vertices) @ turn.T)[:, 2].min())
        for pose in sequence.world_from_tool
    )
