"""compare: where and when a model fails, in millimetres and in units of the measurement's own noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from plop.artifacts.atomic_file import write_json
from plop.checked_settings import check_choices, check_jobs, check_ranges
from plop.comparison.bases import predict_episode
from plop.comparison.camera_errors import camera_rows, camera_table
from plop.comparison.error_fields import ErrorField, error_field, tables
from plop.comparison.field_file import stored_field, write_field
from plop.errors import PlopError
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.set import RecordingSet
from plop.reporting.field_pictures import draw_on_object, draw_over_time, draw_tables
from plop.tracking.episode import Episode
from plop.tracking.phases import PHASES
from plop.tracking.same_object import check_same_object, size_m
from plop.tracking.sets import tracked_episodes
from stages.compare.checks import CONVENTIONS, check_conventions

COMPARE_SCHEMA = 1


@dataclass(frozen=True)
class CompareConfig:
    """Settings of `compare`; their defaults are written only here."""

    split: str = "all"
    """Episodes: "train", "test" or "all"."""
    episodes: str = "*"
    """Only episodes whose name matches this pattern."""
    seed: int = 0
    """Chooses the points that are followed."""
    frames: int = 4
    """Frames of each episode that are rendered through every camera; 0 leaves cameras out."""
    other_object: bool = False
    """Compare although the model was made for another object."""
    pictures: bool = True
    """Draw pictures."""
    jobs: int = dataclasses.field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: CompareConfig, out: Output) -> Summary:
    """Write compare.json, an error field for each episode, and pictures.

    Raises:
        PlopError: Unlike conventions, a model of another object, no episode, or a prediction that is not finite.
    """
    _check(config)
    check_inputs(inputs, config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    check_conventions(inputs, recordings)
    names = _names(recordings, config)
    init = inputs["init"].path
    episodes, left_out = tracked_episodes(recordings, init, inputs["tracks"].path, names, seed=config.seed)
    _same_object(inputs, config, recordings, episodes)
    for folder in ("fields", *(["pictures"] if config.pictures else [])):
        (out.path / folder).mkdir(exist_ok=True)
    fields, cameras = [], []
    tasks = (
        delayed(_compare)(inputs["model"].path, recordings.path(e.name), init / e.name, e, config, out.path)
        for e in episodes
    )
    for field, seen in Parallel(n_jobs=config.jobs, return_as="generator")(tasks):
        fields.append(field)
        cameras += seen
        rms_mm = 1000 * float(np.sqrt((field.error_m**2).mean()))
        out.progress(len(fields), len(episodes), field.name, rms_mm=rms_mm)
    found: dict[str, list[dict[str, Any]]] = tables(fields) | {"camera": camera_table(cameras)}
    facts = _facts(recordings, episodes, fields, found, cameras, left_out)
    write_json(out.path / "compare.json", facts, sort_keys=False)
    if config.pictures:
        draw_tables(out.path / "pictures" / "tables.png", found)
    return _summary(fields, found, left_out)


def _compare(
    model: Path, recording: Path, fit: Path, episode: Episode, config: CompareConfig, folder: Path
) -> tuple[ErrorField, list[dict[str, Any]]]:
    """Predict one episode, write its field and pictures; the field, and what the cameras see of it."""
    field = error_field(episode, predict_episode(model, recording, fit / "object.ply", episode))
    stored = stored_field(field)
    write_field(folder / "fields" / f"{episode.name}.npz", stored)
    if config.pictures:
        draw_over_time(folder / "pictures" / f"{episode.name}_time.png", stored)
        draw_on_object(folder / "pictures" / f"{episode.name}_object.png", stored)
    shown = _shown(len(episode.times), config.frames)
    return field, camera_rows(recording, fit, field, shown) if config.frames else []


def _check(config: CompareConfig) -> None:
    """Refuse settings out of range.

    Raises:
        PlopError: One of them, by name.
    """
    check_jobs(config, "compare")
    check_choices(config, "compare", {"split": ("train", "test", "all")})
    check_ranges(config, "compare", {"frames": (0, inf)})


def check_inputs(inputs: Inputs, config: CompareConfig) -> None:
    """Refuse what recordings and model tell before anything is tracked.

    Raises:
        PlopError: No episode is chosen, or the model is of another object.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    _names(recordings, config)
    _same_object(inputs, config, recordings, [])


def _same_object(inputs: Inputs, config: CompareConfig, recordings: RecordingSet, episodes: list[Episode]) -> None:
    if config.other_object:
        return
    made = inputs["model"].manifest
    check_same_object(
        inputs["model"].path,
        recordings.environment,
        episodes,
        about=made.environment if made is not None else None,
        fix="Choose a model of this object, or give --other-object.",
    )


def _names(recordings: RecordingSet, config: CompareConfig) -> list[str]:
    pools = {"all": recordings.names, "train": recordings.train, "test": recordings.test}
    names = [name for name in pools[config.split] if fnmatchcase(name, config.episodes)]
    if not names:
        raise PlopError(
            "No episode is chosen.",
            where=recordings.folder,
            expected=f"an episode of split {config.split} that matches {config.episodes}",
            found=", ".join(pools[config.split]) or "no episode in this split",
            fix="Change --split or --episodes.",
        )
    return names


def _shown(frames: int, count: int) -> list[int]:
    """Frames spread evenly over the episode; the last is one of them, the first, which is given, is not."""
    return sorted({int(k) for k in np.linspace(0, frames - 1, count + 1)[1:].round()})


def _facts(
    recordings: RecordingSet,
    episodes: list[Episode],
    fields: list[ErrorField],
    found: dict[str, list[dict[str, Any]]],
    cameras: list[dict[str, Any]],
    left_out: dict[str, str],
) -> dict[str, Any]:
    return {
        "schema": COMPARE_SCHEMA,
        "environment": recordings.environment,
        "size_mm": [round(1000 * float(edge), 1) for edge in size_m(episodes)],
        "conventions": CONVENTIONS
        | {
            "error": "distance between measured and predicted place of the same point; RMS over points and frames",
            "first_frame": "given, counts nowhere",
            "floor": "RMS error that the measurement's noise alone gives: sqrt(6) times that of one coordinate",
            "in_noise": "RMS error over the floor; 1 is noise alone",
            "persistence": "nothing moves",
            "rigid": "best motion of the points as one body, fitted to each frame's measurement: an oracle",
            "camera": "Gaussians carried by predicted points and rendered, mean absolute difference; "
            "_floor: carried by the measured points; _persistence, _rigid: by those of the baselines",
            "n": "points times frames; for cameras, pixels",
        },
        "units": {"_mm": "mm", "in_noise": "-", "colour": "0..1", "outline": "share of pixels"},
        "phases": list(PHASES),
        "tables": found,
        "episodes": {f.name: _episode_facts(f) for f in fields},
        "camera_frames": cameras,
        "left_out": left_out,
        "held_out": [f.name for f in fields if f.name in recordings.test],
    }


def _episode_facts(field: ErrorField) -> dict[str, Any]:
    def mm(values: np.ndarray) -> list[float]:
        return [round(1000 * float(v), 4) for v in values]

    return {
        "points": len(field.episode.patch),
        "noise_mm": round(1000 * field.episode.noise_m, 4),
        "floor_mm": round(1000 * field.floor_m, 4),
        "worst_frame": field.worst_frame,
        "time_s": [round(float(t), 6) for t in field.episode.times],
        "phase": field.tool.phase.tolist(),
        "error_mm": mm(field.over_time()),
        "persistence_mm": mm(field.over_time("persistence_m")),
        "rigid_mm": mm(field.over_time("rigid_m")),
    }


def _summary(fields: list[ErrorField], found: dict[str, list[dict[str, Any]]], left_out: dict[str, str]) -> Summary:
    """Say where and when it fails, worst first."""
    whole = found["all"][0]
    keys = {
        "rms_mm": "rms_mm",
        "in_noise": "in_noise",
        "p95_mm": "p95_mm",
        "rigid_mm": "rigid_mm",
        "persistence_mm": "still_mm",
        "floor_mm": "floor_mm",
        "n": "n",
    }

    def short(row: dict[str, Any]) -> dict[str, Any]:
        return {shown: round(row[key], 2) for key, shown in keys.items()}

    kinds = {"episode": "episode", "phase": "phase", "distance": "distance_to_tool_mm", "height": "height_mm"}
    rows = [{"over": "all", "where": f"{len(fields)} episodes", **short(whole)}]
    for kind, label in kinds.items():
        ranked = sorted(found[kind], key=lambda row: -row["rms_mm"])
        over = {"distance": "mm to the tool", "height": "mm above the table"}.get(kind, kind)
        rows += [{"over": over, "where": row[label], **short(row)} for row in ranked[:8]]
    worst = max(fields, key=lambda f: float(f.over_time().max()))
    phase = PHASES[int(worst.tool.phase[worst.worst_frame])]
    since = worst.episode.times[worst.worst_frame] - worst.episode.times[0]
    figures = {
        "episodes": len(fields),
        "rms_mm": round(whole["rms_mm"], 3),
        "in_noise": round(whole["in_noise"], 2),
        "floor_mm": round(whole["floor_mm"], 3),
        "worst": f"{worst.name} at {since:.2f} s ({phase}): {1000 * worst.over_time().max():.2f} mm",
    }
    figures |= {f"camera_{row['camera']}_depth_mm": row["depth_mm"] for row in found["camera"]}
    return Summary(figures, rows, [f"{name} is left out: {why}" for name, why in left_out.items()])


STAGE = Stage(
    name="compare",
    version=8,
    help="Compare a model with measurements: where and when it fails, in mm and in units of the noise.",
    config=CompareConfig,
    inputs={
        "recordings": InputSpec(("calibrate", "ingest", "simulate"), "what was measured"),
        "init": InputSpec(("fit-init",), "Gaussians at frame 0", along="recordings"),
        "tracks": InputSpec(("filter",), "the filter's states", along="recordings"),
        "model": InputSpec(("train", "identify", "augment"), "the model to compare"),
    },
    run=run,
    check=settings_only(_check),
    check_inputs=check_inputs,
)
