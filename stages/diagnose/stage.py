"""diagnose: which physical effect is the model missing? Sensors first, then the library, then a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from plop.diagnosis.decision.result import SensorFault
from plop.diagnosis.diagnose import check_enough, diagnose
from plop.diagnosis.responses.measured import engine_beside, read_measured, unseen
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured
from plop.models import effects_of, innermost, judges_of, trained_on
from plop.physics.effects.library import effect_type, library
from plop.pipeline.stage import Choice, Inputs, InputSpec, Origin, Output, Stage, Summary
from plop.recordings.excluded import check_excluded
from plop.recordings.set import RecordingSet
from plop.setting_kinds import ALL_CORES, SAME_RESULT, Jobs, Seed, Settings, Split
from plop.tracking.episode import Episode
from plop.tracking.same_object import check_same_object
from stages import MODELS, RECORDINGS
from stages.common_inputs import engine_input, init_input, optional, recordings_input, tracks_input
from stages.diagnose.outcome import diagnosis_of, rows_of
from stages.diagnose.sensors import sensor_findings


@dataclass(frozen=True)
class DiagnoseConfig(Settings):
    """Settings of `diagnose`; their defaults are written only here."""

    effects: tuple[str, ...] = ()
    """Only these effects of the library; all when empty."""
    split: Split = "all"
    """Which episodes."""
    sensors: bool = True
    """Look for sensor faults first."""
    exclude: tuple[str, ...] = ()
    """Cameras that neither tracks nor sensor checks use, e.g. one that was found faulty."""
    seed: Seed = 0
    """Chooses the points that are followed."""
    jobs: Jobs = ALL_CORES
    """Processes of this machine; -1 is one a core."""
    scheduler: Annotated[str, SAME_RESULT] = ""
    """Address of a Dask scheduler, e.g. tcp://10.0.0.5:8786, to run the same jobs on a cluster."""


def run(inputs: Inputs, config: DiagnoseConfig, out: Output) -> Summary:
    """Write diagnosis.json.

    Raises:
        PlopError: A model and recordings of different objects, too few episodes, an unknown effect, a file with
            effects that cannot be used, or an engine that follows nothing.
    """
    check(config, {name: given.path for name, given in inputs.items()})
    files = (str(inputs["effect_file"].path),) if "effect_file" in inputs else ()
    types = library(files)
    check_inputs(inputs, config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    model = inputs["model"].path
    engine = engine_beside(model, inputs["engine"].path if "engine" in inputs else None)
    measured, left_out = _read(recordings, inputs, "", _names(recordings, config.split), model, config.seed)
    _same_object(model, recordings, measured.episodes)
    reference, warnings = None, list[str]()
    if "reference" in inputs:
        others = RecordingSet.load(inputs["reference"].path)
        judges = judges_of(model)
        names, warnings = unseen(others.names, trained_on(model) - set(judges))
        # what was added to the base was fitted to recordings that have it; the base's own have not
        reference, more = _read(others, inputs, "reference_", names, innermost(model), config.seed, judges=judges)
        seen = dict.fromkeys(set(others.names) - set(names), "the model was trained on it")
        left_out |= {f"reference {name}": why for name, why in sorted((more | seen).items())}
    sensors = _sensors(recordings, measured, config, out)
    runs = Runs(out.cache or out.path / ".jobs", files, config.jobs, config.scheduler, out.progress)
    found = diagnose(
        measured,
        engine,
        types,
        runs,
        reference=reference,
        effects=config.effects or None,
        sensors=[fault.text for fault in sensors or ()],
        announce=runs.begin,
    )
    runs.forget()
    kept = diagnosis_of(found, types, sensors, left_out, environment=recordings.environment)
    kept.write(out.path)
    figures = {
        "verdict": kept.verdict.kind,
        "named": ", ".join(kept.verdict.named) or "-",
        "text": kept.verdict.text,
        "next": kept.next_step,
        "episodes": len(kept.episodes),
        "engine_runs": runs.done,
    }
    warnings += [f"{name} is left out: {why}" for name, why in kept.dropped.items()]
    return Summary(figures, rows_of(kept), warnings)


def _sensors(
    recordings: RecordingSet, measured: Measured, config: DiagnoseConfig, out: Output
) -> tuple[SensorFault, ...] | None:
    if not config.sensors:
        return None
    return sensor_findings(recordings, [e.name for e in measured.episodes], config.exclude, out, jobs=config.jobs)


def _read(
    recordings: RecordingSet, inputs: Inputs, prefix: str, names: list[str], model: Path, seed: int, **more: Any
) -> tuple[Measured, dict[str, str]]:
    """Read the episodes of one of the two sets."""
    init, tracks = (inputs[f"{prefix}{part}"].path for part in ("init", "tracks"))
    return read_measured(recordings, init, tracks, names, model, seed, **more)


def _names(recordings: RecordingSet, split: str) -> list[str]:
    return recordings.names if split == "all" else list(getattr(recordings, split))


def check(config: DiagnoseConfig, given: Mapping[str, str | Path]) -> None:
    """Refuse unknown effects, and a file with effects that cannot be used.

    Args:
        config: Settings.
        given: The raw inputs among what the user named: "effect_file".

    Raises:
        PlopError: What is wrong.
    """
    types = library((str(given["effect_file"]),) if "effect_file" in given else ())
    for name in config.effects:
        effect_type(name, types)


def check_inputs(inputs: Inputs, config: DiagnoseConfig) -> None:
    """Refuse what recordings and model tell before anything is tracked.

    Raises:
        PlopError: An unknown camera, another object, an added effect that cannot be read, or too few episodes.
    """
    recordings, model = RecordingSet.load(inputs["recordings"].path), inputs["model"].path
    check_excluded(recordings, config.exclude, "diagnose")
    _same_object(model, recordings, [])
    effects_of(model)
    check_enough(len(_names(recordings, config.split)), recordings.skipped)


def _same_object(model: Path, recordings: RecordingSet, episodes: list[Episode]) -> None:
    check_same_object(
        model,
        recordings.environment,
        episodes,
        fix="Give recordings of the same object; materials are compared under one name.",
    )


def _without_cameras(config: DiagnoseConfig) -> dict[str, list[str]]:
    """Leave the cameras that are not trusted out of the tracks, too."""
    return {"exclude": list(config.exclude)}


STAGE = Stage(
    name="diagnose",
    version=73,
    help="Name the physical effect that the model is missing, or say that none can be named.",
    config=DiagnoseConfig,
    inputs={
        "recordings": recordings_input("what was measured", Choice.UNAMBIGUOUS),
        "init": init_input("Gaussians at frame 0"),
        "tracks": tracks_input("the filter's states", settings=_without_cameras),
        "model": InputSpec(MODELS, "the model to diagnose", choice=Choice.ANY_LINE),
        "reference": InputSpec(
            RECORDINGS, "what the model was made from", optional=True, choice=Origin(apart_from="recordings")
        ),
        "reference_init": optional(init_input("its Gaussians", of="reference")),
        "reference_tracks": optional(
            tracks_input("its states", of="reference", init="reference_init", settings=_without_cameras)
        ),
        "engine": engine_input(Choice.MADE),
        "effect_file": InputSpec((), "your own effects, a Python file", optional=True),
    },
    run=run,
    check=check,
    check_inputs=check_inputs,
)
