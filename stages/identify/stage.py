"""identify: fit the engine's material to recordings; the result is a model like any other."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from math import inf
from typing import Any

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.lineage import recordings_content
from plop.checked_settings import check_choices, check_jobs, check_ranges
from plop.dynamics.model_io import MODEL_SCHEMA
from plop.errors import PlopError
from plop.identification.identify import NAMES, identify, outliers, spacing_for, starts_settled
from plop.parameters import short_number
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.calibration.gauss_newton import PARAMETERS, Calibration, Estimate, is_determined
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.scenes.names import one_of
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.set import RecordingSet
from plop.statistics.determined import NOT_DETERMINED
from plop.tracking.same_object import size_m
from plop.tracking.sets import tracked_episodes

STARTS = ("auto", "settled", "unloaded")
CONES = ("round", "pyramid")


@dataclass(frozen=True)
class IdentifyConfig:
    """Settings of `identify`; their defaults are written only here."""

    fit: tuple[str, ...] = NAMES
    """Parameters to fit; the others stay at their first guess."""
    youngs_modulus_pa: float = 1.2e4
    """First guess of Young's modulus [Pa]."""
    poisson: float = 0.4
    """Poisson's ratio [-]."""
    density_kg_m3: float = 1000.0
    """Density [kg/m^3]; with imposed motions only stiffness over density matters."""
    damping_per_s: float = 2.0
    """First guess of the velocity damping [1/s]."""
    table_friction: float = 0.4
    """First guess of the friction at the table [-]."""
    tool_friction: float = 0.3
    """First guess of the friction at the tool [-]."""
    cut_friction: float = 0.3
    """Friction between the faces of a cut [-]."""
    toughness_j_m2: float = 0.0
    """Energy of new cut surface [J/m^2]."""
    table_slip_m_s: float = 0.003
    """First guess of the table's slip speed, below which it rubs in proportion to the speed [m/s]; 0 is Coulomb's law,
    if it is not fitted."""
    table_cone: str = "round"
    """Friction cone at the table: "round", or "pyramid" as some simulators have it."""
    start: str = "auto"
    """Object at the first frame: "settled" under its weight, "unloaded" and about to sag, or "auto": what fits."""
    spacing_m: float = 0.0
    """Distance of the particles [m]; 0 chooses about 1300 of them."""
    iterations: int = 5
    """Most Gauss-Newton steps."""
    split: str = "train"
    """Episodes: "train", "test" or "all". What is fitted to test episodes cannot be scored on them; "all" is for a
    model that is only scored on other recordings."""
    seed: int = 0
    """Chooses the points that are followed."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Processes; -1 is one a core."""


def run(inputs: Inputs, config: IdentifyConfig, out: Output) -> Summary:
    """Fit the engine and write model.json.

    Raises:
        PlopError: A setting that cannot be, no usable episode, or an unstable engine.
    """
    _check(config)
    check_inputs(inputs, config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = _names(recordings, config)
    episodes, left_out = tracked_episodes(
        recordings, inputs["init"].path, inputs["tracks"].path, names, seed=config.seed
    )
    spacing = config.spacing_m or spacing_for(episodes)
    base = EngineBase(_material(config), spacing, True, config.table_cone)
    settled = starts_settled(episodes[:3], base) if config.start == "auto" else config.start == "settled"
    base = replace(base, settled=settled)
    odd = outliers(episodes, base, config.jobs)
    left_out |= odd
    episodes = [episode for episode in episodes if episode.name not in odd]
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
        "estimates": {name: _estimate(name, e) for name, e in found.estimates.items()},
        "training": {
            "environment": recordings.environment,
            "size_m": size_m(episodes).tolist(),
            "episodes": [e.name for e in episodes],
            "recordings": recordings_content(inputs["recordings"].manifest),
            "rms_before_mm": 1000 * found.rms_before_m,
            "rms_after_mm": 1000 * found.rms_after_m,
            "engine_runs": found.rollouts,
        },
    }
    write_json(out.path / "model.json", facts)
    return _summary(base, found, len(episodes), left_out)


def _check(config: IdentifyConfig) -> None:
    """Refuse settings out of range, and parameters that cannot be fitted.

    Raises:
        PlopError: One of them, by name.
    """
    check_jobs(config, "identify")
    check_choices(config, "identify", {"start": STARTS, "split": ("train", "test", "all"), "table_cone": CONES})
    check_ranges(config, "identify", {"iterations": (0, inf), "spacing_m": (0, 0.1)})
    for name in config.fit:
        one_of(name, PARAMETERS, "parameter to fit", where="identify.fit")
    if not config.fit:
        raise PlopError(
            "There is nothing to fit.",
            where="identify.fit",
            expected=f"some of {', '.join(PARAMETERS)}",
            found="none",
            fix="Leave --fit out for the usual ones.",
        )
    _material(config)


def check_inputs(inputs: Inputs, config: IdentifyConfig) -> None:
    """Refuse recordings without an episode to fit to before anything is tracked.

    Raises:
        PlopError: The split holds none.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    if not _names(recordings, config):
        raise PlopError(
            "There is no episode to fit the engine to.",
            where=recordings.folder,
            expected=f"an episode of split {config.split}",
            found="none",
            fix='Change --split: "all" takes every episode.',
        )


def _names(recordings: RecordingSet, config: IdentifyConfig) -> list[str]:
    return recordings.names if config.split == "all" else list(getattr(recordings, config.split))


def _material(config: IdentifyConfig) -> Material:
    """First guess of the material; its ranges are the engine's."""
    given = {key: getattr(config, key) for key in asdict(Material()) if hasattr(config, key)}
    return replace(Material(**given), law=ElasticLaw.NEO_HOOKEAN)


def _estimate(name: str, estimate: Estimate) -> dict[str, Any]:
    values = {**asdict(estimate), "determined": is_determined(name, estimate)}
    return {key: value if not isinstance(value, float) or np.isfinite(value) else None for key, value in values.items()}


def _summary(base: EngineBase, found: Calibration, count: int, left_out: dict[str, str]) -> Summary:
    rows = [
        {
            "parameter": name,
            "value": round(e.value, 4),
            "low": _shown(e.low),
            "high": _shown(e.high),
            "unit": e.unit,
            "told": "yes" if is_determined(name, e) else NOT_DETERMINED,
        }
        for name, e in found.estimates.items()
    ]
    figures = {
        "episodes": count,
        "rms_before_mm": round(1000 * found.rms_before_m, 3),
        "rms_after_mm": round(1000 * found.rms_after_m, 3),
        "spacing_mm": round(1000 * base.spacing_m, 2),
        "settled": base.settled,
        "engine_runs": found.rollouts,
    }
    warnings = [f"{name} is left out: {why}" for name, why in left_out.items()]
    warnings += [
        f"{name} is {NOT_DETERMINED} ({_why(e)}): if it is known, give it and leave it out of --fit."
        for name, e in found.estimates.items()
        if not is_determined(name, e)
    ]
    return Summary(figures, rows, warnings)


def _why(estimate: Estimate) -> str:
    if estimate.at_bound:
        return f"{short_number(estimate.value)} is the end of its range: a limit, not a measurement"
    ends = [short_number(end) if np.isfinite(end) else "anything" for end in (estimate.low, estimate.high)]
    return " to ".join(ends if len(set(ends)) > 1 else ends[:1])


def _shown(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


STAGE = Stage(
    name="identify",
    version=9,
    help="Fit the engine's material to recordings: a physics model like any other.",
    config=IdentifyConfig,
    inputs={
        "recordings": InputSpec(("calibrate", "ingest", "simulate"), "what was measured"),
        "init": InputSpec(("fit-init",), "Gaussians at frame 0", along="recordings"),
        "tracks": InputSpec(("filter",), "the filter's states", along="recordings"),
    },
    run=run,
    check=settings_only(_check),
    check_inputs=check_inputs,
)
