"""The model beside its peers: `python -m benchmarks.peers run pipeline|particles|scaling`, then `score`.

`run` makes what is lacking and can be stopped at any time; `score` gathers it into docs/results/peers.json, whose
other entries stay; `tables` prints that file in Markdown; `strips` draws a picture of every environment.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.facts import machine
from benchmarks.peers.particles import ParticlePlan, carry_out
from benchmarks.peers.pipeline import Pipeline, PipelinePlan
from benchmarks.peers.scaling import COUNTS, measured
from benchmarks.peers.score import (
    PARTICLE_COLUMNS,
    PIPELINE_COLUMNS,
    columns_of,
    particle_tables,
    pipeline_facts,
    pipeline_table,
    read_rows,
    scaling_to_markdown,
    table_to_markdown,
)
from benchmarks.peers.strips import strip
from plop.artifacts.atomic_file import write_json
from plop.errors import PlopError
from plop.pipeline.execute import versions

COMMAND = "python -m benchmarks.peers"
RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "peers.json"


def run(options: argparse.Namespace) -> None:
    """Make what is lacking of one benchmark."""
    if options.name == "pipeline":
        for environment in options.env or ["block"]:
            plan = _pipeline_plan(options, environment)
            Pipeline(options.work, plan).carry_out()
            _note(options.work, f"pipeline-{environment}", {"plan": _plain(vars(plan))})
    elif options.name == "particles":
        if options.data is None:
            raise PlopError(
                "The particle data are not named.",
                where="--data",
                expected="a folder with FluidFall/*.npz and the like",
                found="nothing",
                fix="Pack DPI-Net's data as benchmarks/peers/particle_data.py says, and name the folder.",
            )
        folds, seeds = tuple(options.folds), tuple(options.seeds)
        plans = [
            ParticlePlan(options.data, environment, folds, seeds, options.seconds, options.device, options.horizon)
            for environment in options.env or ["FluidFall"]
        ]
        carry_out(plans, options.work, options.jobs)
        _note(options.work, "particles", {})
    else:
        found = measured(tuple(options.counts), options.limit_s, options.memory_gb, options.rounds, options.device)
        name = "scaling" if options.device == "cpu" else f"scaling-{options.device}"
        _note(options.work, name, {"models": found, "rounds": options.rounds})


def _pipeline_plan(options: argparse.Namespace, environment: str) -> PipelinePlan:
    return PipelinePlan(
        environment, options.data, tuple(options.seeds), options.steps, not options.full, not options.no_engine
    )


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {key: "<folder>" if isinstance(value, Path) else value for key, value in values.items()}


def _note(work: Path, name: str, more: dict[str, Any]) -> None:
    """Write how something was made: its command, without folders, and the machine."""
    folders = "--data", "--work"
    words = [part for word in sys.argv[1:] for part in (word.split("=", 1) if word.startswith(folders) else [word])]
    command = shlex.join("FOLDER" if k and words[k - 1] in folders else word for k, word in enumerate(words))
    write_json(work / f"{name}.json", {"command": f"{COMMAND} {command}", "machine": machine(), **more})


def score(options: argparse.Namespace) -> None:
    """Gather results into the result file; entries that this folder does not have are kept."""
    path: Path = options.result
    kept = json.loads(path.read_text()) if path.is_file() else {}
    environments, training = kept.get("environments", {}), kept.get("training", {})
    made = kept.get("made", {})
    for pipeline, facts in _pipelines(options.work):
        environment = pipeline.plan.environment
        name = f"{environment}, simulated" if pipeline.plan.data is None else environment
        environments[name], training[name] = pipeline_table(pipeline), pipeline_facts(pipeline)
        made[name] = {key: facts[key] for key in ("command", "machine", "plan")}
    tables, trained = particle_tables(read_rows(options.work))
    environments |= tables
    training |= trained
    if (options.work / "particles.json").is_file():
        made |= dict.fromkeys(tables, json.loads((options.work / "particles.json").read_text()))
    scaling = {name: kept.get(name, {}) for name in ("scaling", "scaling-cuda")}
    for name in scaling:
        if (options.work / f"{name}.json").is_file():
            facts = json.loads((options.work / f"{name}.json").read_text())
            scaling[name], made[name] = facts["models"], {key: facts[key] for key in ("command", "machine", "rounds")}
    if not environments and not any(scaling.values()):
        raise PlopError("There is nothing to score.", where=options.work, fix=f"{COMMAND} run pipeline, for example.")
    found = {
        "command": f"{COMMAND} score",
        "machine": machine(),
        "versions": versions(),
        "made": made,
        "environments": environments,
        "training": training,
        **scaling,
    }
    write_json(path, found, sort_keys=False)
    tables_of(options)


def _pipelines(work: Path) -> Iterator[tuple[Pipeline, dict[str, Any]]]:
    """Give the environments that have been carried out, with what was noted of each."""
    for noted in sorted(work.glob("pipeline-*.json")):
        facts = json.loads(noted.read_text())
        plan = facts["plan"]
        given = {**plan, "seeds": tuple(plan["seeds"]), "data": Path() if plan["data"] else None}
        yield Pipeline(work, PipelinePlan(**given)), facts


def strips(options: argparse.Namespace) -> None:
    """Draw every environment beside the result file."""
    folder = options.result.parent / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    for pipeline, _ in _pipelines(options.work):
        strip(pipeline, folder / f"peers-{pipeline.plan.environment}.jpg")


def tables_of(options: argparse.Namespace) -> None:
    """Print the result file."""
    try:
        found = json.loads(options.result.read_text())
        parts = [
            f"{name}\n\n{table_to_markdown(table, columns_of([table], PIPELINE_COLUMNS | PARTICLE_COLUMNS))}"
            for name, table in found["environments"].items()
        ]
        parts += [scaling_to_markdown(found[name]) for name in ("scaling", "scaling-cuda") if found.get(name)]
    except (OSError, ValueError, KeyError) as error:
        raise PlopError(
            "This is not a result of this benchmark.", where=options.result, found=str(error), fix=f"{COMMAND} score"
        ) from error
    sys.stdout.write("\n\n".join(parts) + "\n")


def _count(word: str) -> int:
    """Read a number of steps, frames and the like."""
    if (number := int(word)) < 1:
        raise argparse.ArgumentTypeError(f"at least 1, not {number}")
    return number


def parsed(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    commands = parser.add_subparsers(required=True)

    def command(name: str, work: Callable[[argparse.Namespace], None]) -> argparse.ArgumentParser:
        found = commands.add_parser(name, help=work.__doc__)
        found.set_defaults(command=work)
        found.add_argument("--work", type=Path, default=Path("artifacts/.bench-peers"), help="folder of what is made")
        found.add_argument("--result", type=Path, default=RESULT, help="the result file")
        return found

    making = command("run", run)
    making.add_argument("name", choices=("pipeline", "particles", "scaling"))
    making.add_argument("--env", action="append", help="environment; may be repeated")
    making.add_argument("--data", type=Path, help="folder of DiSECt's recordings, or of particle data")
    making.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    making.add_argument("--steps", type=_count, default=1520, help="pipeline: steps of I2N; peers take the same time")
    making.add_argument("--full", action="store_true", help="pipeline: the demo's or DiSECt's sizes, not small ones")
    making.add_argument("--no-engine", action="store_true", help="pipeline: without the rivals that need an engine")
    making.add_argument("--folds", type=int, nargs="+", default=[0, 1, 2, 3, 4], help="particles: rollouts that test")
    making.add_argument("--seconds", type=float, default=300, help="particles: CPU or GPU time of one training")
    making.add_argument("--horizon", type=_count, default=8, help="particles: frames of an open loop in training")
    making.add_argument("--device", default="cpu", choices=("cpu", "cuda"), help="particles, scaling")
    making.add_argument("--jobs", type=_count, default=1, help="particles: trainings at the same time")
    making.add_argument("--counts", type=_count, nargs="+", default=COUNTS, help="scaling: numbers of particles")
    making.add_argument("--rounds", type=_count, default=5, help="scaling: repetitions")
    making.add_argument("--limit-s", type=float, default=120, help="scaling: most CPU time of both steps")
    making.add_argument("--memory-gb", type=float, default=8, help="scaling: most memory of a process")
    command("score", score)
    command("tables", tables_of)
    command("strips", strips)
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
