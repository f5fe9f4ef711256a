"""Does the named effect help in motions that nothing was fitted to? `python -m studies.fresh_recordings --work W`.

Each W is a workspace that `plop demo-physics` has finished with a named effect. The answer is open there, so that the
same effect is hidden once more, in other motions of another seed; base and augmented model predict them as they are.
Writes docs/results/fresh_recordings.json (merged with what is there) and prints its table.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.workspace import Typed
from plop.errors import PlopError
from plop.physics.scenes.sealed import open_answer
from plop.pipeline.execute import versions

_DOCS = Path(__file__).resolve().parent.parent / "docs"
RESULT = _DOCS / "results" / "fresh_recordings.json"
SEED = 900
"""Added to the seed of the demo; its own recordings have 100 and 200 more."""


class Fresh(Typed):
    """Films new motions in the workspace of a demo and lets its two models predict them."""

    def measured(self) -> dict[str, Any]:
        """Give the errors of base and augmented model on fresh recordings and on those that were diagnosed.

        Raises:
            PlopError: No effect was named there.
        """
        mystery = self.store.find("mystery")
        seed, effects = mystery.manifest.config["seed"] - 200, open_answer(mystery.path)["effects"]
        named = json.loads((self.store.find("verdict").path / "diagnosis.json").read_text())["verdict"]["named"]
        if not named:
            raise PlopError(
                "No effect was named in this workspace.",
                where=self.workspace,
                found="an open verdict",
                expected="a demo whose verdict names one",
                fix="Take another seed.",
            )
        hide = [
            word
            for law, values in effects.items()
            for key, value in values.items()
            for word in ("--hide", f"{law}.{key}={value!r}")
        ]
        self.plop("simulate", "block.toml", *hide, "--seed", str(SEED + seed), "--name", "fresh")
        models = {"before": "base", "after": f"base+{named[0]}"}
        sets = {"fresh": "fresh", "diagnosed": "mystery"}
        rows = {
            key: {when: self.errors(model, recordings) for when, model in models.items()}
            for key, recordings in sets.items()
        }
        return {"seed": seed, "hidden": effects, "named": named, **rows}

    def errors(self, model: str, recordings: str) -> dict[str, Any]:
        """Compare a model with recordings: RMS over all, floor, and RMS of each episode [mm]."""
        name = f"{recordings}-by-{model}"
        self.plop("compare", "--model", model, "--recordings", recordings, "--name", name)
        tables = json.loads((self.store.find(name).path / "compare.json").read_text())["tables"]
        whole = {key: tables["all"][0][key] for key in ("rms_mm", "floor_mm", "persistence_mm", "rigid_mm")}
        return whole | {"episodes": {row["episode"]: row["rms_mm"] for row in tables["episode"]}}


def table(rows: list[dict[str, Any]]) -> str:
    """Set fresh recordings beside those that the amplitude was fitted to."""
    lines = [
        "| seed | hidden and named | fresh: base -> with the effect [mm] | episodes better | persistence, rigid | "
        "fitted to: base -> with the effect [mm] |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        fresh, fitted = row["fresh"], row["diagnosed"]
        pairs = [(fresh["before"]["episodes"][name], after) for name, after in fresh["after"]["episodes"].items()]
        better = sum(after < before for before, after in pairs)
        lines.append(
            f"| {row['seed']} | {', '.join(row['hidden'])}; {', '.join(row['named'])} | {_fall(fresh)} | "
            f"{better} of {len(pairs)} | {fresh['before']['persistence_mm']:.1f}, "
            f"{fresh['before']['rigid_mm']:.1f} | {_fall(fitted)} |"
        )
    return "\n".join(lines)


def _fall(errors: dict[str, Any]) -> str:
    before, after = errors["before"], errors["after"]
    return f"{before['rms_mm']:.2f} -> {after['rms_mm']:.2f} (noise {before['floor_mm']:.2f})"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, nargs="+", required=True, help="Finished workspaces of demo-physics.")
    options = parser.parse_args()
    known = json.loads(RESULT.read_text())["runs"] if RESULT.is_file() else []
    rows = {row["seed"]: row for row in known}
    for work in options.work:
        row = Fresh(work).measured()
        rows[row["seed"]] = row
        sys.stdout.write(f"seed {row['seed']}: {_fall(row['fresh'])}\n")
        runs = [rows[seed] for seed in sorted(rows)]
        facts = {
            "command": "python -m studies.fresh_recordings --work W ...",
            "versions": versions(),
            "seeds": [SEED + seed for seed in sorted(rows)],
            "runs": runs,
        }
        RESULT.write_text(json.dumps(facts, indent=1) + "\n")
        sys.stdout.write(table(runs) + "\n")


if __name__ == "__main__":
    main()
