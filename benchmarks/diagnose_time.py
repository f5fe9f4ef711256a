"""How long `diagnose` and `report` take with eight episodes and as many of the reference.

`python -m benchmarks.diagnose_time --work W` types the commands through cameras (128 px, six of them): recordings with
adhesion hidden, an engine of `identify`'s own 1,300 particles, then `diagnose` with nothing remembered of engine runs:
with twelve laws, with the whole library, and with adhesion left out of the library, so that two laws at once are tried,
which takes longest. Writes docs/results/diagnose_time.json and the table of docs/speed.md. About half an hour of
two cores; what is there already is not made again, but for the diagnoses.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.__main__ import machine
from benchmarks.physics_cameras import FINER, Loop
from plop.artifacts.store import Artifact
from plop.metrics.table import replace_between_markers
from plop.physics.effects.library import library
from plop.pipeline.execute import versions

EPISODES = ("--episodes", "8")
SEED, REFERENCE_SEED, SNR = 4000, 100, 4
HIDDEN = "adhesion"
SCREEN_GOAL_MIN, WHOLE_GOAL_MIN = 6, 15
REPORT_GOAL_S, REPORT_GOAL_MB = 30, 25
OUT, PAGE = Path("docs/results/diagnose_time.json"), Path("docs/speed.md")


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-diagnose"), help="Workspace.")
    options = parser.parse_args()
    loop = Loop(options.work)
    loop.plop("simulate", "block.toml", "--seed", str(REFERENCE_SEED), *EPISODES, "--name", "plain")
    loop.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base", *FINER)
    loop.plop(
        "simulate",
        "block.toml",
        "--seed",
        str(SEED),
        *EPISODES,
        "--hide",
        HIDDEN,
        "--snr",
        str(SNR),
        "--name",
        "mystery",
    )
    loop.plop("compare", "--model", "base", "--recordings", "mystery")  # makes the tracks
    on, rows = machine(), []
    for what, laws in libraries().items():
        rows.append({"what": what, "laws": len(laws), **diagnosed(loop, laws)})
        sys.stdout.write(f"{rows[-1]}\n")
        sys.stdout.flush()
    facts = {
        "command": "python -m benchmarks.diagnose_time",
        "versions": versions(),
        "machine": on,
        "seeds": [REFERENCE_SEED, SEED],
        "diagnoses": rows,
        "report": reported(loop),
    }
    OUT.write_text(json.dumps(facts, indent=1) + "\n")
    PAGE.write_text(replace_between_markers(PAGE.read_text(), "diagnose-time", table(facts)))


YOUNGER = ("cohesion",)
"""Laws that came after the goals and the stored times, which are of twelve."""


def libraries() -> dict[str, list[str]]:
    """Give the laws of each diagnosis: the twelve that act on the object, all, and all but the hidden one."""
    laws = library()
    twelve = [name for name, law in laws.items() if law.kind == "physics" and name not in YOUNGER]
    return {
        "twelve laws": twelve,
        "the whole library": list(laws),
        "the hidden law left out": [name for name in laws if name != HIDDEN],
    }


def diagnosed(loop: Loop, laws: list[str]) -> dict[str, Any]:
    """Diagnose with no engine run remembered."""
    forget(loop)
    words = [word for law in laws for word in ("--effects", law)]
    loop.plop("diagnose", "--model", "base", "--recordings", "mystery", "--name", "timed", "--force", *words)
    found = json.loads((loop.store.find("timed").path / "diagnosis.json").read_text())
    return {
        "verdict": found["verdict"]["kind"],
        "named": found["verdict"]["named"],
        "screen_s": found["seconds_screen"],
        "whole_s": found["seconds"],
        "engine_runs": found["engine_runs"],
        "episodes": len(found["episodes"]),
        "reference_episodes": len(found["reference_episodes"]),
    }


def forget(loop: Loop) -> None:
    """Remove what earlier diagnoses remember of engine runs."""
    shutil.rmtree(loop.store.root / ".cache" / "diagnose", ignore_errors=True)


def reported(loop: Loop) -> dict[str, Any]:
    """Make the report of base and recordings, and say how long it took and how large it is."""
    loop.plop("eval", "--model", "base", "--recordings", "mystery", "--name", "scores")
    loop.plop("report", "--models", "base", "--recordings", "mystery", "--name", "page", "--force")
    page: Artifact = loop.store.find("page")
    return {"seconds": page.manifest.provenance["seconds"], "megabytes": sum(page.manifest.sizes.values()) / 1e6}


def table(facts: dict[str, Any]) -> str:
    """Set what was measured beside the goals, in Markdown."""
    lines = ["| what | engine runs | screen [min] | whole [min] | verdict |", "|---|---|---|---|---|"]
    for row in facts["diagnoses"]:
        named = " ".join([row["verdict"], ", ".join(row["named"])]).strip()
        lines.append(
            f"| diagnose, {row['what']} ({row['laws']}) | {row['engine_runs']} | {row['screen_s'] / 60:.1f} "
            f"| {row['whole_s'] / 60:.1f} | {named} |"
        )
    lines.append(f"| goal, twelve laws | | <= {SCREEN_GOAL_MIN} | <= {WHOLE_GOAL_MIN} | |")
    report = facts["report"]
    lines += [
        "",
        f"`report` of these episodes: {report['seconds']:.1f} s (goal <= {REPORT_GOAL_S}), "
        f"{report['megabytes']:.1f} MB (goal <= {REPORT_GOAL_MB}).",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
