"""Pictures of error fields: over time, on the object, and as a table of phases and episodes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from plop.artifacts.atomic_file import whole
from plop.comparison.error_fields import rms_seen
from plop.comparison.field_file import StoredField
from plop.comparison.result import CameraRow, ErrorRow, ErrorTables
from plop.reporting.colours import ERROR_MAP, FLOOR, PERSISTENCE, PHASE_COLOURS, PREDICTION, RIGID
from plop.tracking.motion_interpolation import MotionInterpolation
from plop.tracking.phases import PHASES, spans

_VIEWS = ((25, -60), (25, 120), (89.9, -90))
"""Elevation and azimuth of the three views of the object [deg]."""


def draw_over_time(path: Path, field: StoredField) -> None:
    """Draw the error over time, with both baselines, the noise floor and shaded phases."""
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots()
    time = field.times_s - field.times_s[0]
    edges = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
    for first, last, name in spans(field.phase):
        axes.axvspan(edges[first], edges[last + 1], color=PHASE_COLOURS[name], linewidth=0, zorder=0)
    lines = (
        ("prediction", field.error_m, PREDICTION, "-", 2.4),
        ("nothing moves", field.persistence_error_m, PERSISTENCE, "--", 1.6),
        ("best rigid motion", field.rigid_error_m, RIGID, "-.", 1.6),
    )
    for label, error, colour, dash, width in lines:
        axes.plot(time, 1000 * rms_seen(error, field.seen), color=colour, linestyle=dash, linewidth=width, label=label)
    axes.fill_between(
        time,
        *1000 * np.quantile(field.error_m, [0.25, 0.75], axis=1),
        color=PREDICTION,
        alpha=0.18,
        linewidth=0,
        label="middle half of the points",
    )
    axes.axhline(1000 * field.floor_m, color=FLOOR, linestyle=":", linewidth=1.4, label="noise floor")
    axes.set(xlabel="time [s]", ylabel="error of the points, RMS [mm]", xlim=(0, time[-1]), title=field.name)
    axes.set_ylim(bottom=0)
    seen = [name for name in PHASES if (field.phase == PHASES.index(name)).any()]
    phases = [Patch(color=PHASE_COLOURS[name], label=name) for name in seen]
    handles = [*axes.get_legend_handles_labels()[0], *phases]
    figure.legend(handles=handles, loc="outside right upper", frameon=False)
    save(figure, path)


def draw_on_object(path: Path, field: StoredField) -> None:
    """Draw the object at the frame with the largest error, coloured by it, from three sides."""
    frame = int(rms_seen(field.error_m, field.seen).argmax())
    carrier = MotionInterpolation(field.points_m[0], field.patch, field.surface_vertices_m)
    places = 1000 * carrier.places_at(field.points_m[frame])
    error = 1000 * carrier.values(field.error_m[frame])[field.surface_faces].mean(1)
    whole = untorn(field.surface_vertices_m, places / 1000, field.surface_faces)
    figure = Figure(figsize=(11, 4), layout="constrained")
    top = max(float(np.quantile(1000 * field.error_m[frame], 0.98)), 1e-3)
    panels = figure.subplots(1, 3, subplot_kw={"projection": "3d"})
    for panel, (elevation, azimuth) in zip(panels, _VIEWS, strict=True):
        mesh = panel.plot_trisurf(
            *places.T, triangles=field.surface_faces[whole], linewidth=0, antialiased=False, cmap=ERROR_MAP, shade=False
        )
        mesh.set_array(error[whole])
        mesh.set_clim(0, top)
        _quiet(panel, places, elevation, azimuth)
    bar = figure.colorbar(mesh, ax=panels, shrink=0.8, extend="max")
    bar.set_label("error [mm]")
    phase = PHASES[int(field.phase[frame])]
    time = field.times_s[frame] - field.times_s[0]
    figure.suptitle(f"{field.name}: largest error, at {time:.2f} s ({phase}); measured shape, two sides and from above")
    save(figure, path)


def untorn(rest: np.ndarray, now: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Tell which triangles were not pulled apart by the cut: no edge grew by more than its length and 3 mm."""
    grown = [np.linalg.norm(p[faces] - p[np.roll(faces, 1, 1)], axis=-1) for p in (rest, now)]
    return np.asarray((grown[1] < 2 * grown[0] + 0.003).all(1))


def _quiet(panel: Any, places: np.ndarray, elevation: float, azimuth: float) -> None:
    low, high = places.min(0), places.max(0)
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    panel.set_box_aspect(high - low, zoom=1.15)
    panel.view_init(elevation, azimuth)
    panel.set_axis_off()


def draw_tables(path: Path, tables: ErrorTables) -> None:
    """Draw the table of episodes and phases, and bars by distance, height and camera."""
    figure = Figure(figsize=(12, 3.4 + 0.3 * len(tables.episode)), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=[1.1, 1])
    left, right = halves
    _heat(left.subplots(), tables)
    distance, height, camera = right.subplots(3, 1)
    _bars(distance, tables.distance, "distance to the tool [mm]")
    _bars(height, tables.height, "height above the table [mm]")
    if tables.camera:
        _bars(camera, tables.camera, "camera (depth, mean)")
    else:
        camera.set_axis_off()
    save(figure, path)


def _heat(axes: Axes, tables: ErrorTables) -> None:
    names = [row.label for row in tables.episode]
    values = np.full((len(names), len(PHASES)), np.nan)
    for each in tables.episode_phase:
        values[names.index(each.labels["episode"]), PHASES.index(each.labels["phase"])] = each.rms_mm
    seen = ~np.isnan(values).all(0)
    values, columns = values[:, seen], [name for name, use in zip(PHASES, seen, strict=True) if use]
    image = axes.imshow(values, cmap=ERROR_MAP, aspect="auto", vmin=0)
    axes.set_xticks(range(len(columns)), columns)
    axes.set_yticks(range(len(names)), names)
    dark = 0.6 * np.nanmax(values)
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", color="white" if value < dark else "black")
    axes.set_title("error by episode and phase, RMS [mm]")
    axes.figure.colorbar(image, ax=axes, label="mm", shrink=0.9)


def _bars(axes: Axes, rows: Sequence[ErrorRow | CameraRow], title: str) -> None:
    labels = [row.label for row in rows]
    tops = [row.error_mm() or 0 for row in rows]
    most = max([*tops, 1e-3])
    axes.bar(labels, tops, color=PREDICTION, width=0.7)
    for place, top in enumerate(tops):
        axes.text(place, top, f"{top:.2f}", ha="center", va="bottom", fontsize=8)
    for name, colour, dash, width in (
        ("persistence", PERSISTENCE, "-", 2.0),
        ("rigid", RIGID, "-", 2.0),
        ("floor", FLOOR, ":", 1.6),
    ):
        marks = [row.error_mm(name) for row in rows]
        for place, mark in enumerate(marks):
            if mark is not None:
                axes.plot([place - 0.4, place + 0.4], [mark, mark], color=colour, linestyle=dash, linewidth=width)
        most = max([most, *(mark for mark in marks if mark is not None)])
    axes.set(ylabel="mm", ylim=(0, 1.25 * most))
    axes.set_title(f"{title}; grey: nothing moves, orange: best rigid motion, dotted: floor", fontsize=9, loc="left")
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def save(figure: Figure, path: Path) -> None:
    """Write a PNG, whole or not at all, the same bytes each time."""
    with whole(path) as scratch:
        figure.savefig(scratch, format="png", dpi=110, metadata={"Software": None})
