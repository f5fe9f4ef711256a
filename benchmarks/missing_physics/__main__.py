"""The missing-physics benchmarks, one after the other or by hand.

`run points|cameras|rough` makes the runs that are lacking and can be stopped at any time; `score` counts the rows into
docs/results/physics_points.json, physics_cameras.json, physics_rough.json and physics.json; `tables` prints these in
Markdown; `compare BEFORE.json AFTER.json` sets the runs of two result files side by side.

A run that neither the folder nor the result file holds by this version of `diagnose` is made (anew); the others keep
the newest verdict that they have had. Start one process a core, with `--share 1/2` and `--share 2/2`.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.missing_physics.cameras import ROUGH, Cameras
from benchmarks.missing_physics.compare import compared
from benchmarks.missing_physics.plan import cameras_plan, points_plan, rough_plan
from benchmarks.missing_physics.points import PARTICLES, Points
from benchmarks.missing_physics.row import Row
from benchmarks.missing_physics.runner import Benchmark, go_on, newest_rows, shared, stored_rows
from benchmarks.missing_physics.score import overview, points_facts, verdict_rates, write_rows
from benchmarks.missing_physics.tables import confusion_table, rates_table, runs_table
from plop.artifacts.atomic_file import write_json
from plop.errors import PlopError

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"
COMMAND = "python -m benchmarks.missing_physics"
PLANS = {"points": points_plan, "cameras": cameras_plan, "rough": rough_plan}


def folder_of(name: str, work: Path) -> Path:
    """Give the folder of one benchmark below --work."""
    return work / f".bench-physics-{name}"


def result_of(name: str, results: Path) -> Path:
    """Give the file of one benchmark's result."""
    return results / f"physics_{name}.json"


def benchmark(name: str, work: Path, *, particles: int, jobs: int) -> Benchmark:
    """Build one of the benchmarks."""
    folder = folder_of(name, work)
    if name == "points":
        return Points(folder, particles=particles, jobs=jobs)
    return Cameras(folder, PLANS[name](), ROUGH if name == "rough" else ())


def run(options: argparse.Namespace) -> None:
    """Make the rows that are lacking."""
    chosen = benchmark(options.name, options.work, particles=options.particles, jobs=options.jobs)
    runs = [each for each in shared(chosen.plan, options.share) if not options.only or each.name in options.only]
    if not runs:
        names = ", ".join(each.name for each in chosen.plan)
        raise PlopError("The plan has no such run.", found=", ".join(options.only), expected=f"of {names}")
    stored = {} if options.again else stored_rows(result_of(options.name, options.results))
    go_on(chosen, runs, stored, options.minutes)


def score(options: argparse.Namespace) -> None:
    """Write the result files from the rows in the folders and, where these lack a run, from the files themselves."""
    for name, plan in PLANS.items():
        path, folder = result_of(name, options.results), folder_of(name, options.work)
        rows = newest_rows([each.name for each in plan()], folder / "rows", stored_rows(path))
        facts = points_facts(rows, options.results) if name == "points" else {"sets": verdict_rates(rows)}
        more: dict[str, object] = {"planned": len(plan())}
        if name == "rough":
            more["recorded"] = " ".join(ROUGH)
        if name == "points":
            engine = folder / "base.json"
            kept = json.loads(path.read_text()).get("engine", {}) if path.is_file() else {}
            more["engine"] = json.loads(engine.read_text()) if engine.is_file() else kept
        write_rows(path, rows, f"{COMMAND} run {name}", **more, **facts)
    both = (json.loads(result_of(name, options.results).read_text()) for name in ("cameras", "points"))
    write_json(options.results / "physics.json", overview(*both), sort_keys=False)


def tables(options: argparse.Namespace) -> None:
    """Print the tables."""
    found = {name: json.loads(result_of(name, options.results).read_text()) for name in PLANS}
    cameras, points = found["cameras"], found["points"]
    fresh = points["sets_after_rules_were_fixed"]
    columns = {"through cameras": cameras["sets"], "followed points": points["sets"], "after the rules": fresh}
    parts = [rates_table(columns), confusion_table(points["confusion"])]
    parts += [runs_table(map(Row.from_json, each["runs"])) for each in found.values()]
    sys.stdout.write("\n\n".join(parts) + "\n")


def compare(options: argparse.Namespace) -> None:
    """Print the runs of two result files side by side."""
    before, after = (list(stored_rows(path).values()) for path in (options.before, options.after))
    sys.stdout.write(compared(before, after) + "\n")


def parsed(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    commands = parser.add_subparsers(required=True)

    def command(work: object, **more: str) -> argparse.ArgumentParser:
        name = getattr(work, "__name__")  # noqa: B009
        found = commands.add_parser(name, help=getattr(work, "__doc__"), **more)  # noqa: B009
        found.set_defaults(command=work)
        found.add_argument("--work", type=Path, default=Path("artifacts"), help="where the folders of runs are")
        found.add_argument("--results", type=Path, default=RESULTS, help="folder of the result files")
        return found

    making = command(run)
    making.add_argument("name", choices=PLANS)
    making.add_argument("--minutes", type=float, default=240, help="stop starting runs after so many minutes")
    making.add_argument("--share", default="1/1", help="K/N: the K-th of N processes; each takes every N-th run")
    making.add_argument("--only", action="append", default=[], metavar="RUN", help="this run of the plan")
    making.add_argument("--again", action="store_true", help="also runs that the result file holds by this version")
    making.add_argument("--jobs", type=int, default=-1, help="processes of one run on points")
    making.add_argument("--particles", type=int, default=PARTICLES, help="of the engine that diagnoses points")
    command(score)
    command(tables)
    comparing = command(compare)
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    return parser.parse_args(words)


def main() -> int:
    """Do what is asked for."""
    options = parsed()
    try:
        options.command(options)
    except PlopError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
