"""plop_episode.json: facts about an episode that plop needs and DROID does not record."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.recordings.readers.droid.layout import DroidFolder, inside
from plop.recordings.readers.droid.pose import check_pose
from plop.recordings.readers.side_file import read_json

NOTES_NAME = "plop_episode.json"
WORKSPACE_M = 5.0
"""Largest extent of a workspace from the robot's base; larger values are taken as millimetres [m]."""
KNOWN = ("scan", "scan_episode", "interaction", "tool", "workspace", "table_z")


@dataclass(frozen=True)
class EpisodeNotes:
    """Content of plop_episode.json; rows of the trajectory, metres, base frame. None = not given."""

    path: Path | None = None
    scan: tuple[int, int] | None = None
    """First and last row, inclusive."""
    scan_episode: Path | None = None
    interaction: tuple[int, int] | None = None
    """First and last row, inclusive."""
    tool_mesh: Path | None = None
    flange_from_tool: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """[x, y, z, a, b, c]"""
    workspace: np.ndarray | None = None
    """Lowest and highest corner, shape [2, 3]."""
    table_z_m: float | None = None


def read_notes(episode: DroidFolder) -> EpisodeNotes:
    """Read the nearest plop_episode.json: the episode's own, or one in a folder above it, up to the raw folder.

    Raises:
        PlopError: The file names an unknown key, a path outside of the raw folder, or numbers that are not metres.
    """
    root, folder = episode.root.resolve(), episode.folder.resolve()
    for candidate in [folder, *(parent for parent in folder.parents if parent.is_relative_to(root))]:
        path = candidate / NOTES_NAME
        if path.is_file():
            return _parse(path, _load(path), episode)
    return EpisodeNotes()


def _load(path: Path) -> dict[str, Any]:
    try:
        content = read_json(path)
    except (OSError, ValueError) as error:
        raise _bad(path, "", "JSON", str(error)) from error
    if not isinstance(content, dict):
        raise _bad(path, "", "a JSON object", type(content).__name__)
    unknown = sorted(set(content) - set(KNOWN))
    if unknown:
        raise _bad(path, unknown[0], "one of " + ", ".join(KNOWN), f"the unknown key {unknown[0]!r}")
    return content


def _parse(path: Path, content: dict[str, Any], episode: DroidFolder) -> EpisodeNotes:
    tool = content.get("tool") or {}
    if not isinstance(tool, dict):
        raise _bad(path, "tool", '{"mesh": "<file>", "flange_from_tool": [6 numbers]}', str(tool))
    mesh = tool.get("mesh")
    offset = _numbers(path, "tool.flange_from_tool", tool.get("flange_from_tool", [0.0] * 6), 6)
    check_pose(offset, where=f"{path}: tool.flange_from_tool", what="tool")
    if np.linalg.norm(offset[:3]) > 2.0:
        raise _bad(path, "tool.flange_from_tool", "metres (a tool within 2 m of the flange)", str(offset[:3]))
    scan_episode = content.get("scan_episode")
    return EpisodeNotes(
        path=path,
        scan=_span(path, "scan", content.get("scan")),
        scan_episode=None if scan_episode is None else _scan_folder(path, str(scan_episode), episode),
        interaction=_span(path, "interaction", content.get("interaction")),
        tool_mesh=None if mesh is None else _mesh_path(path, str(mesh), episode),
        flange_from_tool=offset,
        workspace=_workspace(path, content.get("workspace")),
        table_z_m=_table(path, content.get("table_z")),
    )


def _scan_folder(path: Path, relative: str, episode: DroidFolder) -> Path:
    """Find the scan: relative to the raw folder, or to the episode's own folder."""
    where = f"{path}: scan_episode"
    own = (episode.folder / relative).resolve()
    if own.is_dir() and own.is_relative_to(episode.root.resolve()) and not Path(relative).is_absolute():
        return own
    folder = inside(episode.root, relative, where=where)
    if not folder.is_dir():
        raise _bad(path, "scan_episode", "an episode's folder, relative to the raw folder", f"{relative}: no folder")
    return folder


def _mesh_path(path: Path, relative: str, episode: DroidFolder) -> Path:
    mesh = inside(episode.root, relative, base=path.parent, where=f"{path}: tool.mesh")
    if not mesh.is_file():
        raise _bad(path, "tool.mesh", "a mesh file (STL, OBJ, PLY), relative to this file", f"{relative}: no file")
    return mesh


def _span(path: Path, key: str, value: Any) -> tuple[int, int] | None:
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not all(type(x) is int for x in value):
        raise _bad(path, key, "[first row, last row]", str(value))
    first, last = value
    if not 0 <= first <= last:
        raise _bad(path, key, "0 <= first <= last", str(value))
    return first, last


def _workspace(path: Path, value: Any) -> np.ndarray | None:
    if value is None:
        return None
    if not isinstance(value, dict) or set(value) != {"min", "max"}:
        raise _bad(path, "workspace", '{"min": [x, y, z], "max": [x, y, z]}', str(value))
    box = np.stack([_numbers(path, f"workspace.{end}", value[end], 3) for end in ("min", "max")])
    if np.abs(box).max() > WORKSPACE_M:
        raise _bad(
            path, "workspace", f"metres from the robot's base (within {WORKSPACE_M:g})", f"{box.tolist()}: millimetres?"
        )
    if (box[0] >= box[1]).any():
        raise _bad(path, "workspace", "min below max on every axis", str(box.tolist()))
    return box


def _table(path: Path, value: Any) -> float | None:
    if value is None:
        return None
    height = float(_numbers(path, "table_z", [value], 1)[0])
    if abs(height) > 2:
        raise _bad(path, "table_z", "metres above the robot's base (within 2)", f"{height:g}: millimetres?")
    return height


def _numbers(path: Path, key: str, value: Any, count: int) -> np.ndarray:
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise _bad(path, key, f"{count} finite numbers", str(value))
    return numbers


def _bad(path: Path, key: str, expected: str, found: str) -> PlopError:
    return PlopError(
        "plop_episode.json is not valid.",
        where=f"{path}: {key}" if key else path,
        expected=expected,
        found=found,
        fix="Correct the file (see docs/how-to/droid-layout.md).",
    )
