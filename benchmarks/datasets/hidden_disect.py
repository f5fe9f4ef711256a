"""The hidden DiSECt sets through cameras: `python -m benchmarks.datasets.hidden_disect --data DATA --work W`.

The commands of a user, from raw recordings to the verdict: images of six cameras are rendered, Gaussians fitted and
followed; the engine is fitted to the object's recordings in which nothing is changed, and each set is diagnosed
against these (other motions) and against a set that repeats its motions; two are diagnosed without the law that was
changed, too. ANSWERS.json is opened only at the end.
Resumes after an interruption; writes docs/results/hidden_disect_cameras.json, whose other sets stay.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any

from benchmarks.workspace import Typed
from plop.artifacts.atomic_file import write_json
from plop.artifacts.store import Store
from plop.physics.effects.library import library
from plop.pipeline.execute import versions

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "hidden_disect_cameras.json"
PRISM, CYLINDER = "prism-jelly", "cylinder-jelly"
BASES = {PRISM: "*_part_00[0-4]", CYLINDER: "*_part_*"}
"""Object -> its recordings without a change; prism 005 is faulty (docs/results/prediction.md)."""
REPEATED = "pnull"
SETS = {
    REPEATED: ("disect_hidden_2/prism_null", (PRISM,)),
    "set1": ("disect_hidden/set_1", (PRISM, REPEATED)),
    "set3": ("disect_hidden/set_3", (PRISM, REPEATED)),
    "set4": ("disect_hidden/set_4", (PRISM, REPEATED)),
    "set2": ("disect_hidden/set_2", (PRISM,)),
    "cnull": ("disect_hidden_2/cylinder_null", (CYLINDER,)),
}
"""Name -> folder, and the references: the null of the prism repeats the motions of three sets."""
LEFT_OUT = {"set1": "swelling", "set3": "table_friction"}
"""Laws without which a set is diagnosed again: what was changed is then outside the library."""
RANKED = 4
"""Effects of each ranking that are kept."""
DIGITS = 4
SETTINGS = """\
[filter.update]
iterations = 24

[identify]                          # initial values are those of the recordings, except for the stiffness
fit = ["youngs_modulus_pa", "viscosity_pa_s", "table_friction", "table_slip_m_s", "toughness_j_m2"]
table_cone = "pyramid"
start = "unloaded"                  # the jelly is released at time 0

[identify.material]
youngs_modulus_pa = 8e3
poisson = 0.45
damping_per_s = 0.0                 # the other simulator has no drag on velocities
table_friction = 0.5
tool_friction = 0.5
toughness_j_m2 = 1.0
table_slip_m_s = 0.005
"""


class Sets(Typed):
    """Diagnoses the sets in one workspace."""

    def __init__(self, workspace: Path, data: Path) -> None:
        super().__init__(workspace, SETTINGS)
        self.data = data

    def filmed(self, folder: Path, name: str, *words: str) -> None:
        """Render some recordings as the cameras see them, from the moment the jelly is released."""
        self.plop("ingest", "disect", str(folder), "--from-rest", *words, "--name", f"raw-{name}")
        self.plop("calibrate", "--recordings", f"raw-{name}", "--name", name)

    def base(self, body: str) -> None:
        """Fit the engine to recordings of an object without a change."""
        self.filmed(self.data / "disect", body, "--environment", body, "--episodes", BASES[body])
        self.plop("identify", "--recordings", body, "--split", "all", "--name", f"{body}-engine")

    def diagnosed(self, name: str, folder: str, reference: str, left_out: str = "") -> dict[str, Any]:
        """Diagnose one set, with a law left out of the library if one is given."""
        body = reference if reference in BASES else PRISM
        self.base(body)
        if reference == REPEATED:
            self.filmed(self.data / SETS[REPEATED][0], REPEATED)
        self.filmed(self.data / folder, name)
        verdict = f"v-{name}-{reference}" + (f"-without-{left_out}" if left_out else "")
        words = ["--reference", reference, "--recordings", name, "--name", verdict]
        if left_out:
            words += ["--effects", ",".join(law for law in library() if law != left_out)]
        self.plop("diagnose", "--model", f"{body}-engine", *words)
        motions = "repeated motions" if reference == REPEATED else "other motions"
        return {"set": name, "left_out": left_out, "reference": motions, **collected(self.store, verdict)}


def main() -> None:
    """Diagnose and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="Folder with disect, disect_hidden, disect_hidden_2.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.hidden-disect-cameras"), help="Workspace.")
    parser.add_argument("--sets", default=",".join(SETS), help="some of them, with commas between")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    if unknown := {*options.sets.split(",")} - {*SETS}:
        parser.error(f"--sets: some of {', '.join(SETS)}; not {', '.join(sorted(unknown))}")
    loop, found = Sets(options.work, options.data), []
    for name in options.sets.split(","):
        folder, references = SETS[name]
        for reference, left_out in product(references, ["", LEFT_OUT[name]] if name in LEFT_OUT else [""]):
            found.append(loop.diagnosed(name, folder, reference, left_out))
            sys.stdout.write(f"{name} {reference} {left_out}: {found[-1]['verdict']} {found[-1]['named']}\n")
            sys.stdout.flush()
    kept = json.loads(options.out.read_text())["sets"] if options.out.is_file() else []
    answers = json.loads((options.data / "disect_hidden" / "ANSWERS.json").read_text())
    facts = {
        "command": "python -m benchmarks.datasets.hidden_disect --data DATA --work W",
        "versions": versions(),
        "seeds": [0],
        "sets": merged(kept, [{**each, "answer": answer_of(answers, each["set"])} for each in found]),
    }
    write_json(options.out, facts, sort_keys=False)


def merged(kept: list[dict[str, Any]], found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Replace what was diagnosed anew; the rest stays."""
    key = itemgetter("set", "left_out", "reference")
    return [each for each in kept if key(each) not in set(map(key, found))] + found


def answer_of(answers: dict[str, Any], name: str) -> str:
    """Give what was changed in a set, in words."""
    found = answers.get(f"set_{name.removeprefix('set')}", {})
    return f"{found['effect']}, {found['amplitude']}" if found.get("effect") else "nothing"


def collected(store: Store, name: str) -> dict[str, Any]:
    """Read one diagnosis and keep what the results page shows."""
    artifact = store.find(name)
    facts = json.loads((artifact.path / "diagnosis.json").read_text())
    kept = ("error", "floor", "searches", "episodes", "reference_episodes")
    ranking = [_finding(row) for row in facts["ranking"][:RANKED]]
    verdict = facts["verdict"]
    return {
        "verdict": verdict["kind"],
        "named": verdict["named"],
        "text": verdict["text"],
        "diagnose_version": artifact.manifest.stage_version,
        **{key: _short(facts[key]) for key in kept},
        "seconds": round(artifact.manifest.provenance["seconds"], DIGITS),
        "ranking": ranking,
    }


def _finding(row: dict[str, Any]) -> dict[str, Any]:
    kept = ("effect", "gain", "gain_error", "strength", "p", "passes", "reasons")
    parameters = {
        name: {key: _short(p[key]) for key in ("value", "low", "high", "unit")} for name, p in row["parameters"].items()
    }
    return {**{key: _short(row[key]) for key in kept}, "parameters": parameters}


def _short(value: Any) -> Any:
    return round(value, DIGITS) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
