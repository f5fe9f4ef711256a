"""compare: where and when a model fails, in millimetres and in units of the measurement's own noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from joblib import Parallel, delayed

from plop.artifacts.layouts import ComparisonFiles, Fit, Fits
from plop.comparison.bases import predict_episode
from plop.comparison.camera_errors import camera_rows, camera_table
from plop.comparison.error_fields import ErrorField, error_field, tables
from plop.comparison.field_file import stored_field, write_field
from plop.comparison.result import Comparison, EpisodeErrors, ErrorRow
from plop.compute.workers import workers
from plop.errors import PlopError
from plop.pipeline.stage import Choice, Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.reporting.field_pictures import draw_on_object, draw_over_time, draw_tables
from plop.setting_kinds import ALL_CORES, Jobs, Range, Seed, Settings, Split, Unit
from plop.tracking.episode import Episode
from plop.tracking.phases import PHASES
from plop.tracking.same_object import check_same_object, size_m
from plop.tracking.sets import tracked_episodes
from stages import MODELS
from stages.common_inputs import init_input, recordings_input, tracks_input
from stages.compare.checks import check_conventions


@dataclass(frozen=True)
class CompareConfig(Settings):
    """Settings of `compare`; their defaults are defined only here."""

    split: Split = "all"
    """Split of the episodes."""
    episodes: str = "*"
    """Only episodes whose name matches this pattern."""
    seed: Seed = 0
    """Seed of the choice of tracked points."""
    frames: Annotated[int, Range(0), Unit("frames")] = 4
    """Frames of each episode that are rendered through every camera; 0 skips the comparison of images."""
    other_object: bool = False
    """Compare although the model was made for another object."""
    pictures: bool = True
    """Draw pictures."""
    jobs: Jobs = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""


def run(inputs: Inputs, config: CompareConfig, out: Output) -> Summary:
    """Write compare.json, an error field for each episode, and pictures.

    Raises:
        PlopError: Different conventions, a model of another object, no episode, or a prediction that is not finite.
    """
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
    model = inputs["model"].path
    tasks = (
        delayed(_compare)(model, recordings.path(e.name), Fits(init).episode(e.name), e, config, out.path)
        for e in episodes
    )
    with workers():
        compared = Parallel(n_jobs=config.jobs, return_as="generator")(tasks)
    for field, seen in compared:
        fields.append(field)
        cameras += seen
        rms_mm = 1000 * float(np.sqrt((field.error_m**2).mean()))
        out.progress(len(fields), len(episodes), field.name, rms_mm=rms_mm)
    found = Comparison(
        environment=recordings.environment,
        size_mm=tuple(round(1000 * float(edge), 1) for edge in size_m(episodes)),
        tables=dataclasses.replace(tables(fields), camera=camera_table(cameras)),
        episodes={f.name: _over_time(f) for f in fields},
        camera_frames=tuple(cameras),
        left_out=left_out,
        held_out=tuple(f.name for f in fields if f.name in recordings.test),
    )
    found.write(out.path)
    if config.pictures:
        draw_tables(ComparisonFiles(out.path).tables, found.tables)
    return _summary(fields, found)


def _compare(
    model: Path, recording: Path, fit: Fit, episode: Episode, config: CompareConfig, folder: Path
) -> tuple[ErrorField, list[dict[str, Any]]]:
    """Predict one episode, write its field and pictures; return the field and the errors of the cameras."""
    field = error_field(episode, predict_episode(model, recording, fit.object_splat, episode))
    stored = stored_field(field)
    write_field(ComparisonFiles(folder).field(episode.name), stored)
    if config.pictures:
        draw_over_time(ComparisonFiles(folder).over_time(episode.name), stored)
        draw_on_object(ComparisonFiles(folder).on_object(episode.name), stored)
    shown = _shown(len(episode.times), config.frames)
    return field, camera_rows(recording, fit.folder, field, shown) if config.frames else []


def check_inputs(inputs: Inputs, config: CompareConfig) -> None:
    """Check recordings and model before anything is tracked.

    Raises:
        PlopError: No episode is selected, or the model is of another object.
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
        fix="Choose a model of this object, or use --other-object.",
    )


def _names(recordings: RecordingSet, config: CompareConfig) -> list[str]:
    pools = {"all": recordings.names, "train": recordings.train, "test": recordings.test}
    names = [name for name in pools[config.split] if fnmatchcase(name, config.episodes)]
    if not names:
        raise PlopError(
            "No episode is selected.",
            where=recordings.folder,
            expected=f"an episode of split {config.split} that matches {config.episodes}",
            found=", ".join(pools[config.split]) or "no episode in this split",
            fix="Change --split or --episodes.",
        )
    return names


def _shown(frames: int, count: int) -> list[int]:
    """Return frames spread evenly over the episode, including the last and excluding the first, which is given."""
    return sorted({int(k) for k in np.linspace(0, frames - 1, count + 1)[1:].round()})


def _over_time(field: ErrorField) -> EpisodeErrors:
    def mm(values: np.ndarray) -> tuple[float, ...]:
        return tuple(round(1000 * float(v), 4) for v in values)

    return EpisodeErrors(
        points=len(field.episode.patch),
        noise_mm=round(1000 * field.episode.noise_m, 4),
        floor_mm=round(1000 * field.floor_m, 4),
        worst_frame=field.worst_frame,
        time_s=tuple(round(float(t), 6) for t in field.episode.times),
        phase=tuple(field.tool.phase.tolist()),
        error_mm=mm(field.over_time()),
        persistence_mm=mm(field.over_time("persistence_m")),
        rigid_mm=mm(field.over_time("rigid_m")),
    )


def _summary(fields: list[ErrorField], found: Comparison) -> Summary:
    """Return where and when it fails, worst first."""
    tables, whole = found.tables, found.tables.whole
    kinds = {
        "episode": tables.episode,
        "phase": tables.phase,
        "mm to the tool": tables.distance,
        "mm above the table": tables.height,
    }
    rows = [{"over": "all", "where": f"{len(fields)} episodes", **_short(whole)}]
    for over, each in kinds.items():
        ranked = sorted(each, key=lambda row: -row.rms_mm)
        rows += [{"over": over, "where": row.label, **_short(row)} for row in ranked[:8]]
    worst = max(fields, key=lambda f: float(f.over_time().max()))
    phase = PHASES[int(worst.tool.phase[worst.worst_frame])]
    since = worst.episode.times[worst.worst_frame] - worst.episode.times[0]
    figures = {
        "episodes": len(fields),
        "rms_mm": round(whole.rms_mm, 3),
        "in_noise": round(whole.in_noise, 2),
        "floor_mm": round(whole.floor_mm, 3),
        "worst": f"{worst.name} at {since:.2f} s ({phase}): {1000 * worst.over_time().max():.2f} mm",
    }
    figures |= {f"camera_{row.camera}_depth_mm": row.error_mm() for row in tables.camera}
    return Summary(figures, rows, [f"{name} is left out: {why}" for name, why in found.left_out.items()])


def _short(row: ErrorRow) -> dict[str, Any]:
    return {
        "rms_mm": round(row.rms_mm, 2),
        "in_noise": round(row.in_noise, 2),
        "p95_mm": round(row.p95_mm, 2),
        "rigid_mm": round(row.rigid_mm, 2),
        "still_mm": round(row.persistence_mm, 2),
        "floor_mm": round(row.floor_mm, 2),
        "n": row.n,
    }


STAGE = Stage(
    name="compare",
    version=10,
    help="Compare a model with measurements: where and when it fails, in mm and in units of the noise.",
    config=CompareConfig,
    inputs={
        "recordings": recordings_input("the measurements", Choice.UNAMBIGUOUS),
        "init": init_input("Gaussians at frame 0"),
        "tracks": tracks_input("the filter's states"),
        "model": InputSpec(MODELS, "the model to compare", choice=Choice.ANY_LINE),
    },
    run=run,
    check_inputs=check_inputs,
)
