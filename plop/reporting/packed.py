"""Error fields packed for a page: whole numbers in base64, so that many frames fit into one file."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from plop.comparison.error_fields import rms_seen
from plop.comparison.field_file import StoredField
from plop.tracking.motion_interpolation import MotionInterpolation
from plop.tracking.phases import PHASES, spans

STEP_MM = 0.02
"""Unit of packed places [mm]; 16 bits reach 65 cm to each side."""


def packed_episode(fields: Sequence[StoredField], frames: Sequence[int]) -> dict[str, Any]:
    """Pack one episode as several models predict it.

    Args:
        fields: The episode's error field of every model; measured points are the same in all.
        frames: Frames to show.

    Returns:
        What page.js reads of an episode, but for its images.
    """
    first, chosen = fields[0], list(frames)
    centre = (first.surface_vertices_m.max(0) + first.surface_vertices_m.min(0)) / 2
    carrier = MotionInterpolation(first.points_m[0].astype(float), first.patch, first.surface_vertices_m.astype(float))
    time = (first.times_s - first.times_s[0]).astype(float)
    edges = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
    errors = np.concatenate([field.error_m[1:][field.seen[1:]] for field in fields])
    worst = int(rms_seen(fields[0].error_m, first.seen)[chosen].argmax())
    return {
        "name": first.name,
        "points": len(first.patch),
        "time": _list(time[chosen], 4),
        "phase": [PHASES[int(k)] for k in first.phase[chosen]],
        "curve_frames": chosen,
        "worst": worst,
        "phases": [[float(edges[a]), float(edges[b + 1]), name] for a, b, name in spans(first.phase)],
        "curves": {
            "time": _list(time, 4),
            "models": [_list(1000 * rms_seen(f.error_m, f.seen), 4) for f in fields],
            "persistence": _list(1000 * rms_seen(first.persistence_error_m, first.seen), 4),
            "rigid": _list(1000 * rms_seen(first.rigid_error_m, first.seen), 4),
        },
        "floor_mm": round(1000 * first.floor_m, 4),
        "top_mm": round(max(1000 * float(np.quantile(errors, 0.98)), 1e-2), 2),
        "measured": _places(first.points_m[chosen], centre),
        "predicted": [_places(field.predicted_m[chosen], centre) for field in fields],
        "surface": {
            "rest": _places(first.surface_vertices_m, centre),
            "faces": _b64(first.surface_faces.astype("<u2")),
            "index": _b64(carrier.index.astype("<u2")),
            "weight": _b64((255 * carrier.weight).round().astype(np.uint8)),
        },
        "centre": [0, 0, 0],
        "reach": round(1000 * float(np.linalg.norm(np.ptp(first.surface_vertices_m, axis=0))), 2),
        "table": None if np.isnan(first.table_z_m) else round(1000 * float(first.table_z_m - centre[2]), 2),
        "tool": _tool(first, centre, chosen),
    }


def _tool(field: StoredField, centre: np.ndarray, frames: list[int]) -> dict[str, Any]:
    """The tool's corners and sharp edges [mm, tool frame] and its poses, rows of 3 x 4 [mm]."""
    poses = field.world_from_tool[frames, :3].astype(float)
    poses[..., 3] = 1000 * (poses[..., 3] - centre)
    return {
        "vertices": _list(1000 * field.tool_vertices_m.ravel(), 2),
        "edges": _sharp(field),
        "poses": [_list(pose.ravel(), 4) for pose in poses],
    }


def _sharp(field: StoredField) -> list[int]:
    """Pairs of corners whose two triangles meet at more than about 20 degrees."""
    corner = field.tool_vertices_m[field.tool_faces].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-15)
    meets: dict[tuple[int, int], list[int]] = {}
    for number, face in enumerate(field.tool_faces):
        for k in range(3):
            a, b = sorted((int(face[k]), int(face[k - 1])))
            meets.setdefault((a, b), []).append(number)
    sharp = [edge for edge, own in meets.items() if len(own) < 2 or normal[own[0]] @ normal[own[1]] < 0.94]
    return [index for edge in sharp for index in edge]


def _places(places: np.ndarray, centre: np.ndarray) -> str:
    steps = 1000 * (places.astype(float) - centre) / STEP_MM
    return _b64(np.clip(steps.round(), -32767, 32767).astype("<i2"))


def _b64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def _list(values: np.ndarray, digits: int) -> list[float]:
    return [round(float(v), digits) for v in values]
