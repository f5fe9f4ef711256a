"""What episodes made up by an engine change on the DiSECt recordings: `python -m studies.made_up --work reproduce`.

After `make reproduce` with PROFILE=cpu and with PROFILE=cpu-recordings: rolls out the engines of the former's
workspace, too, scores them as the networks are scored, and prints all three beside each other. Writes
docs/results/disect-engine.json; goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.workspace import Typed, latest
from plop.pipeline.execute import versions
from plop_cli.results_file import gathered

METRICS = {"cd_mm": 2, "emd_mm": 2, "truth_rms_mm": 2, "psnr_db": 1, "j_score": 3}
"""What is shown -> digits."""


class Engines(Typed):
    """Rolls out the engines of a workspace."""

    def scored(self, environment: str) -> Path:
        """Roll out one environment's engine in its test episodes; give the scores."""
        model, recordings, init = (
            latest(self.store, stage, environment).manifest.address for stage in ("identify", "calibrate", "fit-init")
        )
        name = f"{environment}-engine"
        self.plop("rollout", "--model", model, "--recordings", recordings, "--init", init, "--name", name)
        self.plop("eval", "--rollouts", name, "--name", f"{name}-scores")
        return self.store.find(f"{name}-scores").path / "scores.json"


def table(without: Mapping[str, Any], made: Mapping[str, Any], engine: Mapping[str, Any]) -> str:
    """Set means over part recordings side by side, whole and end, and their means over environments.

    Args:
        without: Environment -> scores of the network that learned from recordings alone, as
            in disect-cpu-recordings.json.
        made: The same of the one that learned from made-up episodes, too.
        engine: The same of the engine itself.
    """
    lines = [
        "| environment | model | CD [mm]: whole, end | EMD [mm] | true nodes [mm] | PSNR [dB] | J |",
        "|---|---|---|---|---|---|---|",
    ]
    kinds = {"without": without, "with made-up episodes": made, "the engine itself": engine}
    names = [name for name in without if all(name in each for each in kinds.values())]
    for name in names:
        lines += [_line(name, kind, [each[name]["plop"]]) for kind, each in kinds.items()]
    if len(names) > 1:
        lines += [_line("**mean**", kind, [each[name]["plop"] for name in names]) for kind, each in kinds.items()]
    return "\n".join(lines)


def _line(name: str, kind: str, scores: list[Mapping[str, Any]]) -> str:
    cells = []
    for key, digits in METRICS.items():
        both = [sum(s[key]["mean"] for s in part) / len(part) for part in (scores, [s["end"] for s in scores])]
        cells.append(", ".join(f"{value:.{digits}f}" for value in both))
    return f"| {name} | {kind} | {' | '.join(cells)} |"


def main() -> None:
    """Roll out, score, and write the file and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--work",
        type=Path,
        required=True,
        help="Workspace of make reproduce PROFILE=cpu; the results of cpu-recordings are in --out.",
    )
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results/.")
    options = parser.parse_args()
    results = options.out / "results"
    without, made = (
        json.loads((results / f"{name}.json").read_text())["environments"]
        for name in ("disect-cpu-recordings", "disect")
    )
    engines = Engines(options.work)
    scores = {name: [engines.scored(name)] for name in made}
    facts = gathered(scores, command="python -m studies.made_up --work W", versions=versions(), seeds=[0])
    (results / "disect-engine.json").write_text(json.dumps(facts, indent=1) + "\n")
    sys.stdout.write(table(without, made, facts["environments"]) + "\n")


if __name__ == "__main__":
    main()
