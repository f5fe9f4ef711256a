"""How nearly repeats of a motion show the same response: `python -m studies.shared_responses --work W`.

`diagnose` runs the engine once for each motion and takes what a law changes in a repeat from there. Here it is run in
the repeats, too: recordings and reference of `python -m benchmarks.speed.diagnose` (W is its workspace), each followed
through cameras by itself, six motions, all laws at the amplitudes at which they are tried, with few particles. Compared
are the responses over all patches and frames. Writes docs/results/shared_responses.json.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.store import Store
from plop.diagnosis.diagnose import SURVEY_PARTICLES, survey_of
from plop.diagnosis.responses.hypotheses import candidates_of, hypotheses_of
from plop.diagnosis.responses.measured import engine_beside, read_measured
from plop.diagnosis.responses.repeats import with_shared_patches
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured, Table
from plop.physics.effects.library import library
from plop.pipeline.execute import versions
from plop.recordings.set import RecordingSet


def main() -> None:
    """Compare and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-diagnose"), help="Workspace.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/shared_responses.json"))
    options = parser.parse_args()
    store = Store(options.work)
    base = engine_beside(store.find("base").path, None)
    first, again = with_shared_patches(followed(store, "mystery"), followed(store, "plain"))
    survey = survey_of(base, first.episodes)
    assert survey is not None
    runs = Runs(options.work / ".shared-responses", jobs=options.jobs)
    tables = [Table(Measured(each.episodes), survey, runs) for each in (first, again)]
    hypotheses = [h for h in hypotheses_of(candidates_of(library())) if len(h.runs) == 1]
    for table in tables:
        table.respond(hypotheses)
    found: dict[str, dict[str, Any]] = {}
    for h in hypotheses:
        if any(table.trouble(h) for table in tables):
            continue
        a, b = (np.concatenate([x.ravel() for x in table.response(h)]) for table in tables)
        if a.any() and b.any():
            row = found.setdefault(h.effect, {"cosine": [], "size": []})
            row["cosine"].append(round(float(a @ b / np.sqrt((a @ a) * (b @ b))), 3))
            row["size"].append(round(float(a @ b / (a @ a)), 3))
    for law, row in found.items():
        sys.stdout.write(f"{law}: {row}\n")
    every = {name: np.concatenate([row[name] for row in found.values()]) for name in ("cosine", "size")}
    facts = {
        "command": "python -m studies.shared_responses",
        "versions": versions(),
        "particles": SURVEY_PARTICLES,
        "episodes": len(first.episodes),
        **{
            name: {"median": float(np.median(v)), "least": float(v.min()), "most": float(v.max()), "n": len(v)}
            for name, v in every.items()
        },
        "laws": found,
    }
    write_json(options.out, facts, sort_keys=False)


def followed(store: Store, name: str) -> Measured:
    """Read what was followed in some recordings when `diagnose` judged them."""
    part = "" if name == "mystery" else "reference_"
    given = store.find("timed").manifest.inputs
    init, tracks = (
        store.find(f"{given[part + key]['stage']}@{given[part + key]['fingerprint']}").path
        for key in ("init", "tracks")
    )
    recordings = RecordingSet.load(store.find(name).path)
    base = store.find("base").path
    return read_measured(recordings, init, tracks, recordings.names, base, 0)[0]


if __name__ == "__main__":
    main()
