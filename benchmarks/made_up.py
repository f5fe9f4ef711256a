"""What episodes made up by an engine change on the DiSECt recordings: `python -m benchmarks.made_up W [W ...]`.

Each W is a workspace of one environment with the evaluations `made-eval` and, where it is there, `engine-eval`; the
commands that make them are in docs/results.md, whose table this writes, beside docs/results/disect_made_up.json. The
models without made-up episodes are those of docs/results/disect.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.metrics.table import replace_between_markers
from plop_cli.execute import versions

_DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE, RESULT, WITHOUT = _DOCS / "results.md", _DOCS / "results" / "disect_made_up.json", _DOCS / "results/disect.json"
METHODS = {"with made-up episodes": "made-eval", "the engine itself": "engine-eval"}
"""What a row is called -> name of its evaluation."""
METRICS = ("cd_mm", "emd_mm", "truth_rms_mm", "psnr_db", "j_score")
_PART = "_part_"


def collected(store: Store) -> tuple[str, dict[str, Any]]:
    """Read a workspace: its environment, and each method's scores by test episode, over the whole and at the end."""
    found: dict[str, Any] = {}
    environment = ""
    for method, name in METHODS.items():
        try:
            artifact = store.find(name)
        except PlopError:
            continue
        facts = json.loads((artifact.path / "scores.json").read_text())
        environment = facts["environment"]
        found[method] = {episode: {over: {key: scores["plop"][over][key] for key in METRICS}
                                   for over in ("episode", "end")}
                         for episode, scores in facts["episodes"].items()}  # fmt: skip
    if not found:
        raise PlopError("There is nothing to collect.", where=store.root, expected=" or ".join(METHODS.values()),
                        found="neither", fix="The commands that make them are in docs/results.md.")  # fmt: skip
    return environment, found


def table(environments: Mapping[str, Any], without: Mapping[str, Any]) -> str:
    """Set the means over part recordings side by side, whole and end."""
    lines = ["| environment | model | CD [mm]: whole, end | EMD [mm] | true nodes [mm] | PSNR [dB] | J |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name, found in environments.items():
        plop = without[name]["plop"]
        rows = {"without": {key: (plop[key]["mean"], plop["end"][key]["mean"]) for key in METRICS}}
        for method, episodes in found.items():
            parts = [scores for episode, scores in episodes.items() if _PART in episode]
            rows[method] = {key: tuple(float(np.mean([scores[over][key] for scores in parts]))
                                       for over in ("episode", "end")) for key in METRICS}  # fmt: skip
        for method, row in rows.items():
            shown = [f"{a:.{digits}f}, {b:.{digits}f}" for (a, b), digits in zip(row.values(), (2, 2, 2, 1, 3),
                                                                              strict=True)]  # fmt: skip
            lines.append(f"| {name} | {method} | {' | '.join(shown)} |")
    return "\n".join(lines)


def main() -> None:
    """Write the file and the page's table; environments that are in the file already stay."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("workspaces", nargs="+", type=Path)
    options = parser.parse_args()
    environments = json.loads(RESULT.read_text())["environments"] if RESULT.is_file() else {}
    try:
        environments |= dict(collected(Store(workspace)) for workspace in options.workspaces)
    except PlopError as error:
        sys.exit(str(error))
    facts = {"command": "python -m benchmarks.made_up W [W ...]", "versions": versions(), "seeds": [0],
             "environments": dict(sorted(environments.items()))}  # fmt: skip
    RESULT.write_text(json.dumps(facts, indent=1) + "\n")
    without = json.loads(WITHOUT.read_text())["environments"]
    PAGE.write_text(replace_between_markers(PAGE.read_text(), "made-up", table(facts["environments"], without)))


if __name__ == "__main__":
    main()
