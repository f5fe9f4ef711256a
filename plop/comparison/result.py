"""Result of a comparison: compare.json of `plop compare`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

from plop.artifacts.result_file import ResultFile, fields_to_json
from plop.tracking.phases import PHASES

CONVENTIONS = {
    "units": "m, s",
    "world_frame": "right-handed, z up",
    "error": "distance between measured and predicted place of the same point; RMS over points and frames",
    "first_frame": "given, counts nowhere",
    "floor": "RMS error that the measurement's noise alone gives: sqrt(6) times that of one coordinate",
    "in_noise": "RMS error over the floor; 1 is noise alone",
    "persistence": "nothing moves",
    "rigid": "best motion of the points as one body, fitted to each frame's measurement: an oracle",
    "camera": "Gaussians carried by predicted points and rendered, mean absolute difference; "
    "_floor: carried by the measured points; _persistence, _rigid: by those of the baselines",
    "n": "points times frames; for cameras, pixels",
}
UNITS = {"_mm": "mm", "in_noise": "-", "colour": "0..1", "outline": "share of pixels"}


@dataclass(frozen=True)
class ErrorRow:
    """Errors over some points of some frames; labels come before the figures."""

    labels: Mapping[str, str]
    """Some of "over", "episode", "phase", "distance_to_tool_mm" and "height_mm"."""
    n: int
    """Points times frames."""
    episodes: int
    rms_mm: float
    median_mm: float
    p95_mm: float
    persistence_mm: float
    rigid_mm: float
    floor_mm: float
    in_noise: float
    """RMS error over the floor; 1 is noise alone."""

    @property
    def label(self) -> str:
        """Label of the row, in a table of one kind of label."""
        return next(iter(self.labels.values()))

    def error_mm(self, of: str = "rms") -> float:
        """RMS error [mm] of the prediction ("rms"), of a baseline ("persistence", "rigid") or of noise ("floor")."""
        return float(getattr(self, f"{of}_mm"))

    def to_json(self) -> dict[str, Any]:
        """Return labels and figures side by side."""
        figures = fields_to_json(self)
        return {**figures.pop("labels"), **figures}

    @classmethod
    def from_json(cls, found: Mapping[str, Any]) -> Self:
        """Read what `to_json` wrote; raises KeyError where a figure is missing, ValueError where it is not a number."""
        _, *keys = cls.__dataclass_fields__
        labels = {key: str(value) for key, value in found.items() if key not in keys}
        return cls(labels, int(found["n"]), int(found["episodes"]), *(float(found[key]) for key in keys[2:]))


@dataclass(frozen=True)
class CameraRow:
    """Differences of images in one camera, over episodes and frames."""

    camera: str
    n: int
    """Pixels."""
    images: int
    differences: Mapping[str, float | None]
    """depth_mm, colour and outline of the prediction, and the same with _floor, _persistence and _rigid."""

    @property
    def label(self) -> str:
        """Name of the camera."""
        return self.camera

    def error_mm(self, of: str = "rms") -> float | None:
        """Mean difference in depth [mm] of the prediction, or of a baseline or the floor, see `ErrorRow`."""
        return self.differences.get("depth_mm" if of == "rms" else f"depth_mm_{of}")

    def to_json(self) -> dict[str, Any]:
        """Return all side by side."""
        return {"camera": self.camera, "n": self.n, "images": self.images, **self.differences}

    @classmethod
    def from_json(cls, found: Mapping[str, Any]) -> Self:
        """Read what `to_json` wrote; raises KeyError or ValueError where something is missing or not a number."""
        own = ("camera", "n", "images")
        rest = {key: None if value is None else float(value) for key, value in found.items() if key not in own}
        return cls(str(found["camera"]), int(found["n"]), int(found["images"]), rest)


@dataclass(frozen=True)
class ErrorTables:
    """Errors by what the rows are about."""

    all: tuple[ErrorRow, ...]
    """One row."""
    episode: tuple[ErrorRow, ...]
    phase: tuple[ErrorRow, ...]
    episode_phase: tuple[ErrorRow, ...]
    distance: tuple[ErrorRow, ...]
    height: tuple[ErrorRow, ...]
    camera: tuple[CameraRow, ...] = ()

    @property
    def whole(self) -> ErrorRow:
        """Everything together."""
        return self.all[0]


@dataclass(frozen=True)
class EpisodeErrors:
    """One episode over time, each list with one number per frame."""

    points: int
    noise_mm: float
    """Of one coordinate of a measured point."""
    floor_mm: float
    worst_frame: int
    time_s: tuple[float, ...]
    phase: tuple[int, ...]
    """Numbers of `plop.tracking.phases.PHASES`."""
    error_mm: tuple[float, ...]
    persistence_mm: tuple[float, ...]
    rigid_mm: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Comparison(ResultFile):
    """Where and when a model is wrong."""

    FILE: ClassVar[str] = "compare.json"
    COMMAND: ClassVar[str] = "compare"
    SCHEMA: ClassVar[int] = 1

    environment: str
    size_mm: tuple[float, ...]
    """Edges of the object."""
    conventions: Mapping[str, str] = field(default_factory=lambda: CONVENTIONS)
    units: Mapping[str, str] = field(default_factory=lambda: UNITS)
    phases: tuple[str, ...] = PHASES
    tables: ErrorTables
    episodes: Mapping[str, EpisodeErrors]
    camera_frames: tuple[Mapping[str, Any], ...]
    """The differences of every image, see `plop.comparison.camera_errors.camera_rows`."""
    left_out: Mapping[str, str]
    """Episode -> why."""
    held_out: tuple[str, ...]
    """Test episodes."""
