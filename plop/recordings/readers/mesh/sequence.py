"""A mesh sequence: the raw recording of a simulator, one animated surface and one moving tool.

    <name>.npz   times [T] s, vertices [T, V, 3] m, faces [F, 3], tool_vertices [K, 3] m in the tool's
                 frame, tool_faces [G, 3], world_from_tool [T, 4, 4]; optional: rest_vertices [V, 3] m
                 (the first frame when absent), cut_faces [F] bool (faces that the cut makes), and
                 truth_<key>: further data known only to the simulator
    <name>.json  {"schema": 1, "environment", "source", "table_z_m" (null = no table), "facts": {...}}; optional
                 "units": {"length", "up", "time", "frames_per_second"}: other units and axes are converted

World frame: metres, right-handed, z up. Faces are counter-clockwise seen from outside.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.atomic_file import whole, write_json
from plop.errors import PlopError
from plop.geometry.rigid import check_rigid
from plop.recordings.array_checks import Part
from plop.recordings.readers.declared_units import WorldFrame, declared_in_side_file, seconds_from
from plop.recordings.readers.mesh.npz_file import check_finite, read_npz
from plop.recordings.readers.side_file import RawEpisode, check_has_environment, raw_episode, read_side_file

MESH_SEQUENCE_SCHEMA = 1
_TRUTH = "truth_"
_EXPORT_AGAIN = "Record or export this episode again."
_TRIANGLES = Part((None, 3), advice={(None, 4): "Quads? Triangulate them: (a, b, c, d) -> (a, b, c), (a, c, d)."})
_ARRAYS = {
    "times": Part((None,)),
    "vertices": Part((None, None, 3)),
    "faces": _TRIANGLES,
    "tool_vertices": Part((None, 3)),
    "tool_faces": _TRIANGLES,
    "world_from_tool": Part((None, 4, 4)),
    "rest_vertices": Part((None, 3)),
    "cut_faces": Part((None,)),
}


@dataclass(frozen=True)
class MeshSequence:
    """One simulated episode."""

    name: str
    environment: str
    times: np.ndarray
    """Time of every frame, shape [T], float64, strictly increasing [s]."""
    vertices: np.ndarray
    """Surface of the object over time, shape [T, V, 3] [m]."""
    faces: np.ndarray
    """Triangles, shape [F, 3], int64, counter-clockwise seen from outside."""
    tool_vertices: np.ndarray
    """Shape [K, 3], in the tool's frame [m]."""
    tool_faces: np.ndarray
    """Shape [G, 3], int64."""
    world_from_tool: np.ndarray
    """Pose of the tool at every frame, shape [T, 4, 4]."""
    table_z_m: float | None = 0.0
    """Height of the table [m]; None when there is none."""
    rest_vertices: np.ndarray | None = None
    """Material position of every vertex, shape [V, 3] [m]; the first frame when absent."""
    cut_faces: np.ndarray | None = None
    """Faces created by the cut, bool, shape [F]; none when absent."""
    source: str = "mesh"
    """Source of the episode."""
    truth: dict[str, np.ndarray] = field(default_factory=dict)
    """Further data known only to the simulator; stored in `/truth/<key>` of the recording."""
    facts: dict[str, Any] = field(default_factory=dict)
    """Parameters of the simulator, JSON types only."""
    up: str = "z"
    """Axis of the files that was read as up (the world is z up)."""
    declared: frozenset[str] = frozenset()
    """Which of "up", "length" and "time" the files themselves declare."""
    notes: tuple[str, ...] = ()
    """Notes on how it was read."""

    @property
    def rest(self) -> np.ndarray:
        """Material position of every vertex, shape [V, 3] [m]."""
        return self.vertices[0] if self.rest_vertices is None else self.rest_vertices

    @property
    def is_cut_face(self) -> np.ndarray:
        """Faces created by the cut, bool, shape [F]."""
        return np.zeros(len(self.faces), bool) if self.cut_faces is None else self.cut_faces

    def __len__(self) -> int:
        return len(self.times)


def write_mesh_sequence(folder: str | Path, sequence: MeshSequence) -> Path:
    """Write `<name>.npz` and `<name>.json`, the JSON last; the same sequence gives the same bytes.

    Args:
        folder: Where to write; created when it does not exist.
        sequence: The episode.

    Returns:
        Path of the npz file.

    Raises:
        PlopError: The sequence contradicts itself (lengths, indices, NaN).
    """
    check_mesh_sequence(sequence, sequence.name)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {
        "times": np.asarray(sequence.times, np.float64),
        "vertices": np.asarray(sequence.vertices, np.float32),
        "faces": np.asarray(sequence.faces, np.int32),
        "tool_vertices": np.asarray(sequence.tool_vertices, np.float64),
        "tool_faces": np.asarray(sequence.tool_faces, np.int32),
        "world_from_tool": np.asarray(sequence.world_from_tool, np.float64),
        "rest_vertices": np.asarray(sequence.rest, np.float32),
        "cut_faces": np.asarray(sequence.is_cut_face, bool),
        **{_TRUTH + key: np.asarray(value) for key, value in sorted(sequence.truth.items())},
    }
    path = folder / f"{sequence.name}.npz"
    with whole(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **arrays)
    side = {
        "schema": MESH_SEQUENCE_SCHEMA,
        "environment": sequence.environment,
        "source": sequence.source,
        "table_z_m": sequence.table_z_m,
        "facts": sequence.facts,
    }
    write_json(path.with_suffix(".json"), side)
    return path


def list_mesh_sequences(folder: Path) -> list[RawEpisode]:
    """List the mesh sequences of a folder by name, reading only their JSON files.

    Raises:
        PlopError: There are none.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise PlopError(
            "There are no mesh sequences in this folder.",
            where=folder,
            expected="<name>.npz and <name>.json",
            found="no .npz file",
            fix="Give the folder written by the simulator.",
        )
    return [raw_episode(path, _read_side, lambda name: re.sub(r"_\d+$", "", name)) for path in paths]


def read_mesh_sequence(path: str | Path) -> MeshSequence:
    """Read `<name>.npz` and the `<name>.json` beside it.

    Args:
        path: Path of the npz file.

    Raises:
        PlopError: A file is missing or truncated, a key is absent or of the wrong type, or the content contradicts
            itself.
    """
    path = Path(path)
    side = _read_side(path.with_suffix(".json"))
    arrays = read_npz(path, _ARRAYS, optional=("rest_vertices", "cut_faces"), fix=_EXPORT_AGAIN)
    said = declared_in_side_file(side, path.with_suffix(".json"))
    frame = WorldFrame(said.up or "z", said.metres or 1.0)
    times, notes = seconds_from(arrays["times"], said.seconds or 1.0)
    rest = arrays.get("rest_vertices")
    sequence = MeshSequence(
        name=path.stem,
        environment=side["environment"],
        times=times,
        vertices=frame.points(arrays["vertices"].astype(np.float64)),
        faces=arrays["faces"].astype(np.int64),
        tool_vertices=frame.points(arrays["tool_vertices"].astype(np.float64)),
        tool_faces=arrays["tool_faces"].astype(np.int64),
        world_from_tool=_poses(arrays["world_from_tool"].astype(np.float64), frame, path),
        table_z_m=side.get("table_z_m"),
        rest_vertices=None if rest is None else frame.points(rest.astype(np.float64)),
        cut_faces=arrays["cut_faces"].astype(bool) if "cut_faces" in arrays else None,
        source=side.get("source", "mesh"),
        truth=_truth(arrays, frame),
        facts=side.get("facts", {}),
        up=frame.up,
        declared=said.said,
        notes=tuple(notes),
    )
    check_mesh_sequence(sequence, path)
    return sequence


def _poses(world_from_tool: np.ndarray, frame: WorldFrame, path: Path) -> np.ndarray:
    check_rigid(world_from_tool, f"{path}: world_from_tool", what="tool")
    poses = world_from_tool.copy()
    if frame.up != "z":
        poses[:, :3, :3] = frame.rotations(poses[:, :3, :3])
    poses[:, :3, 3] = frame.points(poses[:, :3, 3])
    return poses


def _truth(arrays: dict[str, np.ndarray], frame: WorldFrame) -> dict[str, np.ndarray]:
    """Extract data known only to the simulator; positions (`..._m`, three numbers each) are converted like the rest."""
    truth = {key.removeprefix(_TRUTH): value for key, value in arrays.items() if key.startswith(_TRUTH)}
    return {
        key: frame.points(value).astype(value.dtype) if key.endswith("_m") and value.shape[-1:] == (3,) else value
        for key, value in truth.items()
    }


def check_mesh_sequence(sequence: MeshSequence, where: str | Path) -> None:
    """Raise PlopError where a sequence contradicts itself; `where` is named in the message."""
    frames, count = len(sequence.times), np.shape(sequence.vertices)[1] if np.ndim(sequence.vertices) == 3 else -1
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        "times": (sequence.times, (frames,)),
        "vertices": (sequence.vertices, (frames, count, 3)),
        "world_from_tool": (sequence.world_from_tool, (frames, 4, 4)),
        "rest_vertices": (sequence.rest, (count, 3)),
        "faces": (sequence.faces, (len(sequence.faces), 3)),
        "cut_faces": (sequence.is_cut_face, (len(sequence.faces),)),
        "tool_vertices": (sequence.tool_vertices, (len(sequence.tool_vertices), 3)),
        "tool_faces": (sequence.tool_faces, (len(sequence.tool_faces), 3)),
    }
    for key, (value, shape) in shapes.items():
        if np.shape(value) != shape or 0 in shape:
            raise PlopError(
                "The arrays of this episode are inconsistent.",
                where=f"{where}: {key}",
                expected=f"shape {shape}, no dimension empty",
                found=f"shape {np.shape(value)}",
                fix=_EXPORT_AGAIN,
            )
        check_finite(value, f"{where}: {key}")
    check_rigid(sequence.world_from_tool, f"{where}: world_from_tool", what="tool")
    if (np.diff(sequence.times) <= 0).any():
        raise PlopError(
            "Time does not increase.",
            where=f"{where}: times",
            expected="strictly increasing seconds",
            found=f"a step of {np.diff(sequence.times).min():g} s",
        )
    for key, faces, limit in (
        ("faces", sequence.faces, count),
        ("tool_faces", sequence.tool_faces, len(sequence.tool_vertices)),
    ):
        if faces.min() < 0 or faces.max() >= limit:
            from_one = faces.min() >= 1 and faces.max() == limit
            raise PlopError(
                "A face refers to a vertex that does not exist.",
                where=f"{where}: {key}",
                expected=f"indices 0..{limit - 1}",
                found=f"{faces.min()}..{faces.max()}",
                fix="If indices count from 1, as in OBJ files and MATLAB, subtract 1." if from_one else _EXPORT_AGAIN,
            )


def _read_side(path: Path) -> dict[str, Any]:
    kinds = {"environment": str, "schema": int, "source": str, "facts": dict, "units": dict}
    side = read_side_file(path, kinds, fix=_EXPORT_AGAIN)
    if side.get("schema", MESH_SEQUENCE_SCHEMA) > MESH_SEQUENCE_SCHEMA:
        raise PlopError(
            "The episode was written by a newer version.",
            where=path,
            expected=f"schema {MESH_SEQUENCE_SCHEMA}",
            found=f"schema {side['schema']}",
            fix="Update plop.",
        )
    check_has_environment(side, path, fix=_EXPORT_AGAIN)
    height = side.get("table_z_m")
    if height is not None and (type(height) not in (int, float) or not np.isfinite(height)):
        raise PlopError(
            "The height of the table is not a number.",
            where=f"{path}: table_z_m",
            expected="metres without quotes, or null where there is no table",
            found=repr(height),
            fix="Correct the JSON file.",
        )
    return side


def begun_at_rest(sequence: MeshSequence) -> MeshSequence:
    """Extend an episode back to its rest shape at time 0 when its first frame lies later.

    The tool is extrapolated back at its first velocity. Other time-dependent data of the simulator are extended if
    known at rest: `truth["rest_<key>"]` becomes the first frame of `truth["<key>"]`.
    """
    times, poses = sequence.times, sequence.world_from_tool
    if times[0] <= 0 or sequence.rest_vertices is None or len(times) < 2:
        return sequence
    before = poses[0].copy()
    before[:3, 3] -= (poses[1, :3, 3] - poses[0, :3, 3]) / (times[1] - times[0]) * times[0]
    at_rest = {key: sequence.truth[f"rest_{key}"] for key in sequence.truth if f"rest_{key}" in sequence.truth}
    truth = sequence.truth | {
        key: np.concatenate([rest[None].astype(sequence.truth[key].dtype), sequence.truth[key]])
        for key, rest in at_rest.items()
    }
    return replace(
        sequence,
        times=np.r_[0.0, times],
        world_from_tool=np.concatenate([before[None], poses]),
        vertices=np.concatenate([sequence.rest[None], sequence.vertices]),
        truth=truth,
    )
