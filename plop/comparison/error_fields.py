"""Where and when a prediction differs from the measured points, without any hypothesis.

Errors are distances between measured and predicted positions of the same point. They are compared with two baselines,
*persistence* (nothing moves) and *rigid* (the best rigid motion of the points, fitted to the measurement of each
frame: an oracle), and with the noise floor: the error from measurement noise alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from plop.comparison.result import ErrorRow, ErrorTables
from plop.errors import PlopError
from plop.geometry.rigid import kabsch, transform_points
from plop.tracking.episode import Episode
from plop.tracking.phases import PHASES, ToolView, view_tool

DISTANCE_EDGES_M = (0.0, 0.005, 0.01, 0.02, 0.04, np.inf)
"""Bands of distance to the tool [m]."""
HEIGHT_EDGES_M = (-np.inf, 0.01, 0.02, 0.03, 0.04, 0.06, np.inf)
"""Bands of height above the table, or above the object's lowest point without a table [m]."""


@dataclass(frozen=True)
class ErrorField:
    """Errors of one episode's prediction; T frames, M points."""

    episode: Episode
    predicted: np.ndarray
    """[T, M, 3] [m]."""
    error_m: np.ndarray
    """[T, M] [m]; the first frame is given, its error zero."""
    persistence_m: np.ndarray
    """[T, M] [m]."""
    rigid_m: np.ndarray
    """[T, M] [m]."""
    height_m: np.ndarray
    """Height of the measured points above the table, [T, M] [m]."""
    tool: ToolView
    seen: np.ndarray
    """Whether a point is visible, bool [T, M]; points hidden by the tool are masked."""

    @property
    def name(self) -> str:
        """Name of the episode."""
        return self.episode.name

    @property
    def floor_m(self) -> float:
        """RMS error from noise alone: noise of a frame and of the first one, in three coordinates [m]."""
        return float(np.sqrt(6) * self.episode.noise_m)

    def over_time(self, which: str = "error_m") -> np.ndarray:
        """RMS over the visible points, [T] [m]."""
        return rms_seen(getattr(self, which), self.seen)

    @property
    def worst_frame(self) -> int:
        """Frame with the largest RMS error."""
        return int(self.over_time().argmax())


def rms(values: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Root mean square."""
    return np.asarray(np.sqrt(np.square(values).mean(axis)))


def rms_seen(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Root mean square over the visible points, [T, M] -> [T]; over all where none is visible."""
    use = np.where(seen.any(1, keepdims=True), seen, True)
    return np.asarray(np.sqrt((np.square(values) * use).sum(1) / use.sum(1)))


def error_field(episode: Episode, predicted: np.ndarray) -> ErrorField:
    """Compare a prediction with the measured points.

    Args:
        episode: What was measured.
        predicted: Predicted places, [T, M, 3] [m].

    Raises:
        PlopError: The prediction has another shape, is not finite, or does not start at the measured points.
    """
    points = episode.points
    if predicted.shape != points.shape or not np.isfinite(predicted).all():
        raise PlopError(
            "The prediction cannot be compared.",
            where=episode.name,
            expected=f"finite points {points.shape}",
            found=f"points {predicted.shape}",
            fix="Roll the model out on these recordings.",
        )
    start = float(np.abs(predicted[0] - points[0]).max())
    if start > 1e-4:
        raise PlopError(
            "The prediction does not start at the measured points.",
            where=episode.name,
            expected="the measured points of the first frame, in metres, world frame",
            found=f"{1000 * start:.2g} mm away",
            fix="Check its units and its frame.",
        )
    body = np.stack([transform_points(kabsch(points[0], now), points[0]) for now in points])
    floor = episode.table_z_m if episode.table_z_m is not None else float(episode.vertices[:, 2].min())
    return ErrorField(
        episode,
        predicted,
        _distance(predicted, points),
        _distance(points[:1], points),
        _distance(body, points),
        points[..., 2] - floor,
        view_tool(episode),
        _seen(episode),
    )


def _seen(episode: Episode) -> np.ndarray:
    return np.ones(episode.points.shape[:2], bool) if episode.seen is None else episode.seen


def _distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(one - other, axis=-1))


def tables(fields: Sequence[ErrorField]) -> ErrorTables:
    """Summarise the errors by episode, phase, phase of each episode, distance to the tool, and height.

    The first frame, which is given, and points hidden by the tool are masked. Rows without a point are
    left out.
    """
    everywhere = [f.seen for f in fields]
    phases = [np.broadcast_to(f.tool.phase[:, None], f.error_m.shape) for f in fields]
    distance = [f.tool.distance_m for f in fields]
    height = [f.height_m for f in fields]
    return ErrorTables(
        all=_present([row_of(fields, everywhere, {"over": "all"})]),
        episode=_present(row_of([f], [e], {"episode": f.name}) for f, e in zip(fields, everywhere, strict=True)),
        phase=_present(row_of(fields, [p == k for p in phases], {"phase": PHASES[k]}) for k in range(len(PHASES))),
        episode_phase=_present(
            row_of([f], [p == k], {"episode": f.name, "phase": PHASES[k]})
            for f, p in zip(fields, phases, strict=True)
            for k in range(len(PHASES))
        ),
        distance=_bands(fields, distance, DISTANCE_EDGES_M, "distance_to_tool_mm"),
        height=_bands(fields, height, HEIGHT_EDGES_M, "height_mm"),
    )


def _bands(
    fields: Sequence[ErrorField], values: list[np.ndarray], edges: Sequence[float], name: str
) -> tuple[ErrorRow, ...]:
    return _present(
        row_of(fields, [(v >= low) & (v < high) for v in values], {name: band_text(low, high)})
        for low, high in zip(edges[:-1], edges[1:], strict=True)
    )


def band_text(low: float, high: float) -> str:
    """Write a band of metres in mm: "5-10", "< 5", "> 40"."""
    if not np.isfinite(high):
        return f"> {1000 * low:g}"
    return f"{1000 * low:g}-{1000 * high:g}" if np.isfinite(low) and low > 0 else f"< {1000 * high:g}"


def _present(rows: Iterable[ErrorRow | None]) -> tuple[ErrorRow, ...]:
    return tuple(row for row in rows if row is not None)


def row_of(fields: Sequence[ErrorField], chosen: Sequence[np.ndarray], labels: dict[str, str]) -> ErrorRow | None:
    """Summarise the chosen points of several episodes in one row.

    Args:
        fields: Errors of the episodes.
        chosen: Which points of which frames, bool [T, M] each.
        labels: What the row is about.

    Returns:
        None without points.
    """
    after = [mask & f.seen & (np.arange(len(mask)) > 0)[:, None] for f, mask in zip(fields, chosen, strict=True)]
    count = int(sum(mask.sum() for mask in after))
    if not count:
        return None
    errors = _chosen(fields, after, "error_m")
    # The floor of a row is the mean over its episodes, weighted by their number of points.
    floor = np.sqrt(np.average([f.floor_m**2 for f in fields], weights=[mask.sum() for mask in after]))

    def mm(value: np.ndarray | np.floating) -> float:
        return round(1000 * float(value), 4)

    return ErrorRow(
        labels,
        n=count,
        episodes=sum(bool(mask.any()) for mask in after),
        rms_mm=mm(rms(errors)),
        median_mm=mm(np.median(errors)),
        p95_mm=mm(np.quantile(errors, 0.95)),
        persistence_mm=mm(rms(_chosen(fields, after, "persistence_m"))),
        rigid_mm=mm(rms(_chosen(fields, after, "rigid_m"))),
        floor_mm=mm(floor),
        in_noise=round(float(rms(errors) / floor), 3),
    )


def _chosen(fields: Sequence[ErrorField], masks: Sequence[np.ndarray], name: str) -> np.ndarray:
    return np.concatenate([getattr(f, name)[mask] for f, mask in zip(fields, masks, strict=True)])
