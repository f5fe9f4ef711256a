"""plan: what to record so that a law is seen, or distinguished from another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from plop.diagnosis.decision.result import Diagnosis
from plop.diagnosis.diagnose import check_enough
from plop.diagnosis.responses.hypotheses import candidates_of
from plop.diagnosis.responses.measured import engine_beside, read_measured, unseen
from plop.diagnosis.responses.runs import Runs
from plop.errors import PlopError
from plop.models import effects_of, innermost, judges_of, trained_on
from plop.parameters import short_number, with_unit
from plop.physics.effects.library import effect_type, library
from plop.physics.scenes.names import one_of
from plop.pipeline.stage import Choice, Inputs, InputSpec, Origin, Output, Stage, Summary
from plop.planning.motions import Change
from plop.planning.plan import Wish, plan
from plop.planning.protocol import plan_of, write_plan
from plop.planning.questions import found_by
from plop.planning.result import Plan
from plop.recordings.set import RecordingSet
from plop.setting_kinds import ALL_CORES, COMMON, SAME_RESULT, Jobs, Range, Seed, Settings
from plop.tracking.same_object import check_same_object
from stages import MODELS, RECORDINGS
from stages.common_inputs import engine_input, init_input, tracks_input

CHANGES = tuple(change.name.lower() for change in Change if change != Change.NONE)


@dataclass(frozen=True)
class PlanConfig(Settings):
    """Settings of `plan`; their defaults are written only here."""

    between: Annotated[tuple[str, ...], COMMON] = ()
    """Laws to distinguish, two or more, e.g. adhesion,cohesion; or give --diagnosis for those of its verdict."""
    effects: tuple[str, ...] = ()
    """Only these effects of the library; all when empty."""
    vary: Annotated[tuple[str, ...], COMMON] = CHANGES
    """How the robot may change a recorded motion: slower, faster, farther, deeper, resting, reversed; "none" repeats
    the recorded motions only."""
    repeats: Annotated[int, Range(1, 8), COMMON] = 4
    """Recordings of every motion, in each set, that are tried at most; fewer where these would be more than 60."""
    again: Annotated[bool, COMMON] = True
    """The motion that distinguishes is recorded with the reference object, too; --no-again where that is gone."""
    seed: Seed = 0
    """Chooses the points that are followed, and draws the evidence."""
    jobs: Jobs = ALL_CORES
    """Processes of this machine; -1 is one a core."""
    scheduler: Annotated[str, SAME_RESULT] = ""
    """Address of a Dask scheduler, e.g. tcp://10.0.0.5:8786, to run the same jobs on a cluster."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.vary if self.vary != ("none",) else ():
            one_of(name, CHANGES, "change", where="vary")
        if len(set(self.between)) == 1 or len(set(self.between)) < len(self.between):
            raise PlopError(
                "Laws cannot be distinguished from themselves.",
                where="between",
                expected="two laws or more, each once",
                found=", ".join(self.between),
                fix="Name them with a comma: --between adhesion,tilt.",
            )

    @property
    def changes(self) -> tuple[Change, ...]:
        """Ways in which motions may be changed."""
        return tuple(Change[name.upper()] for name in self.vary if name != "none")


def run(inputs: Inputs, config: PlanConfig, out: Output) -> Summary:
    """Write plan.json, protocol.md and, where a motion is new, its path.

    Raises:
        PlopError: A model without engine or of another object, too few episodes, an unknown law or one without
            response, a diagnosis that leaves nothing to distinguish, or an engine that follows nothing.
    """
    check(config, {name: given.path for name, given in inputs.items()})
    check_inputs(inputs, config)
    files = _files(inputs)
    recordings, model = RecordingSet.load(inputs["recordings"].path), inputs["model"].path
    engine = engine_beside(model, inputs["engine"].path if "engine" in inputs else None)
    judges = judges_of(model)
    names, warnings = unseen(recordings.names, trained_on(model) - set(judges))
    init, tracks = inputs["init"].path, inputs["tracks"].path
    measured, left_out = read_measured(recordings, init, tracks, names, innermost(model), config.seed, judges=judges)
    check_same_object(model, recordings.environment, measured.episodes, fix=_SAME_OBJECT)
    check_enough(len(measured.episodes), left_out)
    # the engine runs of the reference are those with which a diagnosis begins
    cache = out.path / ".jobs" if out.cache is None else out.cache.with_name("diagnose")
    runs = Runs(cache, files, config.jobs, config.scheduler, out.progress)
    found = plan(
        measured,
        engine,
        library(files),
        runs,
        Wish(config.between, _diagnosis(inputs), config.changes, config.repeats, config.again, config.seed),
        effects=config.effects or None,
        announce=runs.begin,
    )
    runs.forget()
    warnings += _at_the_end(_diagnosis(inputs))
    found.dropped.update(left_out)
    kept = plan_of(found, diagnosed="diagnosis" in inputs, again=config.again, environment=recordings.environment)
    write_plan(kept, found.best, out.path)
    figures: dict[str, Any] = {"plan": kept.text, "episodes": sum(step.repeats for step in kept.steps)}
    if kept.separation is not None:
        figures |= {"motion": kept.separation.motion, "settled": round(kept.separation.settled, 2)}
    figures["engine_runs"] = runs.done
    warnings += [f"{name} is left out: {why}" for name, why in kept.dropped.items()]
    return Summary(figures, rows_of(kept), warnings)


def rows_of(kept: Plan) -> list[dict[str, Any]]:
    """Give the laws, or the motions that distinguish, as rows for the terminal."""
    if kept.separation is not None:
        return [
            {"motion": choice.motion, "information_nats": round(choice.information, 2)}
            for choice in kept.separation.choices[:8]
        ]
    return [
        {
            "law": law.effect,
            "seen_from": "-" if law.amplitude is None else with_unit(short_number(law.amplitude), law.unit),
            "typical": with_unit(short_number(law.typical), law.unit),
            **{f"seen_with_{count}": f"{100 * chance:.0f} %" for count, chance in enumerate(law.chances, 1)},
            "repeats": law.repeats or f"more than {len(kept.ways)}",
        }
        for law in kept.laws
    ]


_SAME_OBJECT = "Give the recordings that the model was made from, or others of the same object."


def _files(inputs: Inputs) -> tuple[str, ...]:
    return (str(inputs["effect_file"].path),) if "effect_file" in inputs else ()


def _diagnosis(inputs: Inputs) -> Diagnosis | None:
    return Diagnosis.load(inputs["diagnosis"].path) if "diagnosis" in inputs else None


def _at_the_end(diagnosis: Diagnosis | None) -> list[str]:
    """Warn of laws that were found at the end of their range: the law that is there is not the one that is drawn."""
    named = [] if diagnosis is None else diagnosis.named
    laws = [row.effect for row in named if any(estimate.at_bound for estimate in row.parameters.values())]
    if not laws:
        return []
    return [
        f"{' and '.join(laws)}: found at the end of the range, so that there may be more of it, or another setting, "
        "than the library holds; the chance to settle it is less than stated."
    ]


def check(config: PlanConfig, given: Mapping[str, str | Path]) -> None:
    """Refuse unknown effects, a file with effects that cannot be used, and two questions at once.

    Raises:
        PlopError: What is wrong.
    """
    types = library((str(given["effect_file"]),) if "effect_file" in given else ())
    for name in (*config.effects, *config.between):
        effect_type(name, types)
    if config.between and "diagnosis" in given:
        raise PlopError(
            "Both --between and --diagnosis say what is to be distinguished.",
            found=", ".join(config.between),
            fix="Leave one of them out.",
        )


def check_inputs(inputs: Inputs, config: PlanConfig) -> None:
    """Refuse what recordings, model and diagnosis tell before anything is tracked.

    Raises:
        PlopError: Another object, an added effect that cannot be read, too few episodes, or a diagnosis that leaves
            nothing to distinguish.
    """
    recordings, model = RecordingSet.load(inputs["recordings"].path), inputs["model"].path
    check_same_object(model, recordings.environment, [], fix=_SAME_OBJECT)
    effects_of(model)
    check_enough(len(recordings.names), recordings.skipped)
    diagnosis = _diagnosis(inputs)
    if diagnosis is not None and diagnosis.environment != recordings.environment:
        raise PlopError(
            "The diagnosis is of another object.",
            where=inputs["diagnosis"].path,
            expected=recordings.environment,
            found=diagnosis.environment,
            fix="Give a diagnosis of recordings of this object.",
        )
    if diagnosis is not None:
        found_by(diagnosis, candidates_of(library(_files(inputs))))


STAGE = Stage(
    name="plan",
    version=18,
    help="Plan recordings: which laws would be seen, how many repeats, and the motion that distinguishes laws.",
    config=PlanConfig,
    inputs={
        "recordings": InputSpec(
            RECORDINGS, "reference recordings, in which nothing is missing: their motions are planned", choice=Origin()
        ),
        "init": init_input("Gaussians at frame 0"),
        "tracks": tracks_input("the filter's states"),
        "model": InputSpec(MODELS, "the base", choice=Choice.ANY_LINE),
        "engine": engine_input(Choice.MADE),
        "diagnosis": InputSpec(
            ("diagnose",), "a diagnosis whose verdict is not unique", optional=True, choice=Choice.NAMED
        ),
        "effect_file": InputSpec((), "your own effects, a Python file", optional=True),
    },
    run=run,
    check=check,
    check_inputs=check_inputs,
)
