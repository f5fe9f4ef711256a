"""identify: fit the engine's material to recordings; the result is a model like any other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Annotated, Literal

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Model
from plop.artifacts.lineage import recordings_content
from plop.comparison.discretisations import spacing_for
from plop.dynamics.i2n.model_io import MODEL_SCHEMA
from plop.errors import PlopError
from plop.identification.identify import NAMES, PARTICLES, identify, starts_settled
from plop.parameters import NOT_DETERMINED, Estimate, short_number
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.gauss_newton import Calibration
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.engine.config import TableCone
from plop.physics.engine.material import Material
from plop.physics.scenes.names import one_of
from plop.pipeline.stage import Choice, Inputs, Output, Stage, Summary
from plop.recordings.set import RecordingSet
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Seed, Settings, Split, Unit
from plop.tracking.same_object import size_m
from plop.tracking.sets import tracked_episodes
from stages.common_inputs import init_input, recordings_input, tracks_input

FIRST_GUESS = Material(
    youngs_modulus_pa=1.2e4,
    damping_per_s=2.0,
    table_friction=0.4,
    tool_friction=0.3,
    cut_friction=0.3,
    table_slip_m_s=0.003,
)
"""Initial material of fits: a soft dough, different from the default material of scenes."""
ODD = 2.0
"""An episode with so many times the error of the median one, a quarter of its weight, is pointed out."""


@dataclass(frozen=True)
class IdentifyConfig(Settings):
    """Settings of `identify`; their defaults are defined only here."""

    fit: Annotated[tuple[str, ...], COMMON] = NAMES
    """Parameters of the material to fit; the others keep their initial values."""
    material: Material = FIRST_GUESS
    """Initial values of the material: the mean of a weak prior where fitted, kept where not."""
    table_cone: Annotated[TableCone, COMMON] = "round"
    """Friction cone at the table: "round", or "pyramid" as in some simulators."""
    start: Annotated[Literal["auto", "settled", "unloaded"], COMMON] = "auto"
    """Object at the first frame: "settled" under its weight, "unloaded" and about to sag, or "auto": the better fit."""
    spacing_m: Annotated[float, Range(0, 0.1), Unit("m"), COMMON] = 0.0
    """Distance of the particles; 0 chooses about 1300 of them."""
    iterations: Annotated[int, Range(0), Unit("steps"), COMMON] = 5
    """Largest number of Gauss-Newton steps."""
    split: Annotated[Split, COMMON] = "train"
    """Episodes to fit to. A model fitted to test episodes cannot be scored on them; "all" is for a model that is only
    scored on other recordings."""
    seed: Annotated[Seed, COMMON] = 0
    """Seed of the choice of tracked points."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes; -1 is one per core."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.fit:
            one_of(name, PARAMETERS, "parameter", where="fit")
        if not self.fit:
            raise PlopError(
                "There is nothing to fit.",
                where="fit",
                expected=f"some of {', '.join(PARAMETERS)}",
                found="none",
                fix="Omit --fit for the default ones.",
            )


def run(inputs: Inputs, config: IdentifyConfig, out: Output) -> Summary:
    """Fit the engine and write model.json.

    Raises:
        PlopError: An invalid setting, no usable episode, or an unstable engine.
    """
    check_inputs(inputs, config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = _names(recordings, config)
    episodes, left_out = tracked_episodes(
        recordings, inputs["init"].path, inputs["tracks"].path, names, seed=config.seed
    )
    spacing = config.spacing_m or spacing_for(episodes, PARTICLES)
    base = EngineBase(config.material, spacing, True, config.table_cone)
    settled = starts_settled(episodes[:3], base) if config.start == "auto" else config.start == "settled"
    base = replace(base, settled=settled)
    base, found = identify(
        episodes,
        base,
        config.fit,
        iterations=config.iterations,
        jobs=config.jobs,
        progress=lambda step, steps, rms: out.progress(step, steps, "Gauss-Newton", rms_mm=1000 * rms),
    )
    facts = {
        "schema": MODEL_SCHEMA,
        "kind": "engine",
        "engine": base_to_dict(base),
        "estimates": {name: e.to_json() for name, e in found.estimates.items()},
        "training": {
            "environment": recordings.environment,
            "size_m": size_m(episodes).tolist(),
            "episodes": [e.name for e in episodes],
            "recordings": recordings_content(inputs["recordings"].manifest),
            "rms_before_mm": 1000 * found.rms_before_m,
            "rms_after_mm": 1000 * found.rms_after_m,
            "episodes_rms_mm": [1000 * rms for rms in found.episodes_rms_m],
            "engine_runs": found.rollouts,
        },
    }
    write_json(Model(out.path).facts, facts)
    return _summary(base, found, [e.name for e in episodes], left_out)


def check_inputs(inputs: Inputs, config: IdentifyConfig) -> None:
    """Reject recordings without an episode to fit to before anything is tracked.

    Raises:
        PlopError: The split is empty.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    if not _names(recordings, config):
        raise PlopError(
            "There is no episode to fit the engine to.",
            where=recordings.folder,
            expected=f"an episode of split {config.split}",
            found="none",
            fix='Change --split: "all" uses every episode.',
        )


def _names(recordings: RecordingSet, config: IdentifyConfig) -> list[str]:
    return recordings.names if config.split == "all" else list(getattr(recordings, config.split))


def _summary(base: EngineBase, found: Calibration, episodes: list[str], left_out: dict[str, str]) -> Summary:
    rows = [
        {
            "parameter": name,
            "value": round(e.value, 4),
            "low": _shown(e.low),
            "high": _shown(e.high),
            "unit": e.unit,
            "determined": "yes" if e.determined else NOT_DETERMINED,
        }
        for name, e in found.estimates.items()
    ]
    figures = {
        "episodes": len(episodes),
        "rms_before_mm": round(1000 * found.rms_before_m, 3),
        "rms_after_mm": round(1000 * found.rms_after_m, 3),
        "spacing_mm": round(1000 * base.spacing_m, 2),
        "settled": base.settled,
        "engine_runs": found.rollouts,
    }
    warnings = [f"{name} is left out: {why}" for name, why in left_out.items()]
    middle = float(np.median(found.episodes_rms_m))
    warnings += [
        f"{name} counts little: the engine misses it by {1000 * rms:.2f} mm RMS, the median episode by "
        f"{1000 * middle:.2f} mm. Something else happened in it, or a law is missing."
        for name, rms in zip(episodes, found.episodes_rms_m, strict=True)
        if rms > ODD * middle
    ]
    warnings += [
        f"{name} is {NOT_DETERMINED} ({_why(e)}): if it is known, set it and remove it from --fit."
        for name, e in found.estimates.items()
        if not e.determined
    ]
    return Summary(figures, rows, warnings)


def _why(estimate: Estimate) -> str:
    if estimate.at_bound:
        return f"{short_number(estimate.value)} is a bound of its range: a limit, not a measurement"
    ends = [short_number(end) if isfinite(end) else "anything" for end in (estimate.low, estimate.high)]
    return " to ".join(ends if len(set(ends)) > 1 else ends[:1])


def _shown(value: float) -> float | None:
    return round(value, 4) if isfinite(value) else None


STAGE = Stage(
    name="identify",
    version=19,
    help="Fit the engine's material to recordings: a physics model like any other.",
    config=IdentifyConfig,
    inputs={
        "recordings": recordings_input("the measurements", Choice.UNAMBIGUOUS),
        "init": init_input("Gaussians at frame 0"),
        "tracks": tracks_input("the filter's states"),
    },
    run=run,
    check_inputs=check_inputs,
)
