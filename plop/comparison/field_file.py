"""Error fields in files: fields/<episode>.npz of `plop compare`, everything in metres and seconds, world frame.

times_s [T]                     points_m, predicted_m [T, M, 3]       error_m, persistence_error_m,
phase [T], see `phases`         tool_distance_m, height_m [T, M]      rigid_error_m [T, M]
noise_m (one coordinate of a    patch [M]                             floor_m (RMS error from noise alone)
measured point)                 surface_vertices_m [V, 3], surface_faces [F, 3] (first frame)
tool_vertices_m [K, 3], tool_faces [G, 3], world_from_tool [T, 4, 4]  table_z_m (NaN: no table)
seen [T, M] bool: points hidden by the tool are extrapolated by the tracker and masked
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from plop.artifacts.atomic_file import whole
from plop.comparison.error_fields import ErrorField
from plop.errors import PlopError
from plop.tracking.motion_interpolation import fine_surface

SURFACE_EDGE_M = 0.007
"""Longest edge of the stored surface [m]."""


@dataclass(frozen=True)
class StoredField:
    """One episode's error field as read from its file; see the module for shapes and units."""

    name: str
    times_s: np.ndarray
    points_m: np.ndarray
    predicted_m: np.ndarray
    error_m: np.ndarray
    persistence_error_m: np.ndarray
    rigid_error_m: np.ndarray
    seen: np.ndarray
    tool_distance_m: np.ndarray
    height_m: np.ndarray
    phase: np.ndarray
    patch: np.ndarray
    noise_m: float
    floor_m: float
    surface_vertices_m: np.ndarray
    surface_faces: np.ndarray
    tool_vertices_m: np.ndarray
    tool_faces: np.ndarray
    world_from_tool: np.ndarray
    table_z_m: float


def stored_field(field: ErrorField) -> StoredField:
    """Return the file's content; the surface is divided finely enough to carry colours."""
    episode = field.episode
    vertices, faces = fine_surface(episode.vertices, episode.faces, SURFACE_EDGE_M)
    return StoredField(
        episode.name,
        episode.times,
        episode.points,
        field.predicted,
        field.error_m,
        field.persistence_m,
        field.rigid_m,
        field.seen,
        field.tool.distance_m,
        field.height_m,
        field.tool.phase.astype(np.int8),
        episode.patch,
        episode.noise_m,
        field.floor_m,
        vertices,
        faces,
        episode.tool.vertices,
        episode.tool.faces,
        episode.tool.world_from_tool,
        np.nan if episode.table_z_m is None else episode.table_z_m,
    )


def write_field(path: Path, field: StoredField) -> None:
    """Write one file atomically; numbers as float32, times as float64."""
    arrays = {}
    for name, value in vars(field).items():
        array = np.asarray(value)
        small = array.dtype == np.float64 and name != "times_s"
        arrays[name] = array.astype(np.float32) if small else array
    with whole(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def read_field(path: Path) -> StoredField:
    """Read one file.

    Raises:
        PlopError: It is missing, damaged or incomplete.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in StoredField.__dataclass_fields__}
    except (OSError, KeyError, ValueError, BadZipFile) as error:
        raise PlopError(
            "The error field cannot be read.",
            where=path,
            expected="a file of `plop compare`",
            found=str(error),
            fix="Run `plop compare` again.",
        ) from error
    single = {name: arrays[name].item() for name in ("noise_m", "floor_m", "table_z_m", "name")}
    return StoredField(**{**arrays, **single})
