"""Name what another simulator hid: `python -m studies.datasets.hidden_disect --data DATA`.

DATA is the folder with disect and disect_hidden. The engine is fitted to the part recordings of `disect/prism_jelly`
and diagnoses the four sets of `disect_hidden` from 400 followed points of the surface with 0.3 mm noise (an ideal
tracker, no cameras). ANSWERS.json is opened when all verdicts are on the disk, and only for the column beside them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plop.diagnosis.candidates import Candidate, candidates_of
from plop.diagnosis.conclusion import Diagnosis
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.evidence import compared_frames
from plop.diagnosis.responses import Answer, Job
from plop.diagnosis.runs import Runs
from plop.diagnosis.table import Measured, Table
from plop.finite import json_ready
from plop.identification.identify import identify, outliers, spacing_for
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import library
from plop.physics.engine.material import Material
from plop.pipeline.execute import versions
from plop.recordings.readers.disect.episode import list_disect, read_disect
from plop.tracking.episode import Episode, episode_from_sequence
from stages.diagnose.stage import STAGE

NOISE_M = 3e-4
FITTED = ("youngs_modulus_pa", "viscosity_pa_s", "table_friction", "table_slip_m_s", "toughness_j_m2")
"""What is fitted. The simulator has no drag on velocities but viscous tetrahedra, friction on the table that is
limited by a speed as well as by Coulomb's law, and springs that hold the cut until they break."""
SETS = ("set_1", "set_2", "set_3", "set_4")
FACTORS = (0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0)
"""Multiples of the fitted amplitude among which the other episodes choose the one for an episode: responses are not
proportional to amplitudes."""
OTHER = "prism_foam"
"""Another material of the same shape and tool: recordings of `disect` against the base of the jelly."""


def episodes_of(folder: Path, pattern: str) -> list[Episode]:
    """Read recordings and follow points of their surface."""
    chosen = [entry for entry in list_disect(folder) if entry.path.match(pattern)]
    names = {entry.path: f"{folder.name}/{entry.name}" for entry in chosen}
    return [
        episode_from_sequence(read_disect(path), noise_m=NOISE_M, seed=zlib.crc32(name.encode()), name=name)
        for path, name in names.items()
    ]


def first_guess(reference: list[Episode]) -> EngineBase:
    """Start the fit of the engine near what the recordings state; the tool's friction stays as they state it."""
    material = Material(
        youngs_modulus_pa=8e3,
        poisson=0.45,
        density_kg_m3=1000,
        viscosity_pa_s=5.0,
        table_friction=0.5,
        table_slip_m_s=5e-3,
        tool_friction=0.5,
        toughness_j_m2=1.0,
    )
    return EngineBase(material, spacing_for(reference), settled=False, table_cone="pyramid")


def fitted_base(reference: list[Episode], work: Path, jobs: int) -> EngineBase:
    """Fit the engine to the reference, once."""
    path = work / "base.json"
    if not path.is_file():
        base, found = identify(reference, first_guess(reference), FITTED, iterations=5, jobs=jobs)
        path.write_text(
            json.dumps(
                {
                    "engine": base_to_dict(base),
                    "rms_mm": 1000 * found.rms_after_m,
                    "rms_before_mm": 1000 * found.rms_before_m,
                }
            )
        )
    return base_from_dict(json.loads(path.read_text())["engine"])


def named_candidate(found: Diagnosis) -> Candidate:
    """Give what was named, or else the best effect, with its response at the fitted amplitude."""
    name = found.verdict.named[0] if found.verdict.named else found.scores[0].candidate.effect
    if name == found.scores[0].candidate.effect:
        return found.scores[0].candidate
    parameters = next(f for f in found.findings if f.name == name).parameters
    candidate = next(c for c in candidates_of(library()) if c.effect == name)
    columns = tuple(replace(c, value=parameters[c.amplitude]["value"]) for c in candidate.columns)
    return replace(candidate, columns=columns)


def before_and_after(found: Diagnosis, measured: Measured, base: EngineBase, runs: Runs) -> dict[str, float]:
    """Predict each episode with the best effect, at the amplitude with which the others are followed best.

    Returns:
        RMS error of the patches in mm, without and with it.
    """
    best, episodes = named_candidate(found), measured.episodes
    plain = runs([Job(episode, base) for episode in episodes])
    table = Table(measured, base, runs)
    given = {episode.name: said for episode, said in zip(table.episodes, table.predictions, strict=True)}
    trials = [tuple((column, factor * column.value) for column in best.columns) for factor in FACTORS]
    answers = [plain, *(runs([Job(episode, base, trial) for episode in episodes]) for trial in trials)]
    errors = np.array(
        [
            [_error(e, given.get(e.name, ()), p, a) for e, p, a in zip(episodes, plain, row, strict=True)]
            for row in answers
        ]
    )
    before, after = errors[0], errors[1:]
    chosen = [int(np.argmin(after.sum(1) - after[:, k])) for k in range(len(episodes))]
    own = after[chosen, np.arange(len(episodes))]
    return {"before": 1000 * float(np.sqrt(before.mean())), "after": 1000 * float(np.sqrt(own.mean()))}


def _error(episode: Episode, predicted: Sequence[np.ndarray], plain: Answer, answer: Answer) -> float:
    """Mean squared error of the patches at the compared frames [m^2]; infinite where the engine is unstable."""
    if plain.points is None or answer.points is None:
        return np.inf
    frames, points = compared_frames(len(episode.times)), np.mean(predicted, 0) + (answer.points - plain.points)
    error = episode.pooled((points - points[:1])[frames]) - episode.motion[frames]
    return float((error**2).sum(-1).mean())


def run_set(
    name: str,
    data: Path,
    reference: Measured,
    base: EngineBase,
    work: Path,
    jobs: int,
    measure: Callable[[list[Episode]], Measured] = Measured,
) -> dict[str, Any]:
    """Diagnose one set; `measure` puts the base's predictions beside episodes, where the base is not the engine."""
    folder, pattern = (data / "disect", f"{OTHER}_part_*") if name == OTHER else (data / "disect_hidden" / name, "*")
    measured = measure(episodes_of(folder, pattern))
    started = time.perf_counter()
    runs = Runs(work / "jobs", jobs=jobs)
    found = diagnose(measured, base, library(), runs, reference=reference)
    row = {
        "set": name,
        "judged_by": STAGE.version,
        "verdict": found.verdict.kind,
        "named": found.verdict.named,
        "text": found.verdict.text,
        "ranking": [
            {
                "effect": f.name,
                "gain": f.gain,
                "gain_error": f.gain_error,
                "p": f.p,
                "contrast": f.contrast and f.contrast.errors,
                "contrast_p": f.contrast and f.contrast.p,
                "alone": f.alone,
                "parameters": f.parameters,
                "reasons": f.reasons(),
            }
            for f in [*found.findings[:6], found.findings[-1]]
        ],
        "error": found.size.error,
        "floor": found.size.floor,
        "left": found.verdict.evidence.get("left"),
        "excess": found.size.excess,
        "held_out_rms_mm": before_and_after(found, measured, base, runs),
        "seconds": time.perf_counter() - started,
        "dropped": found.dropped,
    }
    return dict(json_ready(row))


def run_sets(names: Sequence[str], work: Path, run: Callable[[str], dict[str, Any]]) -> list[dict[str, Any]]:
    """Diagnose the sets that are not in the folder yet, and read them all."""
    for name in names:
        path = work / f"{name}.json"
        if not path.is_file():
            row = run(name)
            path.write_text(json.dumps(row, indent=1))
            sys.stdout.write(f"{name}: {row['verdict']} {row['named']} {row['held_out_rms_mm']}\n")
            sys.stdout.flush()
    return [json.loads((work / f"{name}.json").read_text()) for name in names]


def answers_of(data: Path) -> dict[str, Any]:
    """Read what was hidden: only when all verdicts are on the disk."""
    answers = json.loads((data / "disect_hidden" / "ANSWERS.json").read_text())
    return {name: answer["effect"] for name, answer in answers.items()}


def reference_of(data: Path, work: Path, jobs: int) -> tuple[list[Episode], EngineBase, dict[str, str]]:
    """Read the reference and fit the engine to it; what the engine misses is left out, and told."""
    episodes = episodes_of(data / "disect", "prism_jelly_part_*")
    base = fitted_base(episodes, work, jobs)
    odd = outliers(episodes, base, jobs)
    return [episode for episode in episodes if episode.name not in odd], base, odd


def main() -> None:
    """Diagnose all sets, then score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=Path("artifacts/.hidden-disect"))
    parser.add_argument("--out", type=Path, default=Path("docs/results/hidden_disect.json"))
    parser.add_argument("--jobs", type=int, default=-1)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    reference, base, odd = reference_of(options.data, options.work, options.jobs)
    known = Measured(reference)
    rows = run_sets(
        (*SETS, OTHER), options.work, lambda name: run_set(name, options.data, known, base, options.work, options.jobs)
    )
    facts = {
        "command": "python -m studies.datasets.hidden_disect --data DATA",
        "versions": versions(),
        "seeds": [0],
        "base": json.loads((options.work / "base.json").read_text()),
        "left_out": odd,
        "sets": rows,
        "answers": answers_of(options.data) | {OTHER: "all that makes the foam another material than the jelly"},
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(facts, indent=1))


if __name__ == "__main__":
    main()
