"""A plan in words and as files: which motions, how often, in which order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from plop.artifacts.atomic_file import write_text
from plop.diagnosis.rule import RULE
from plop.geometry.rigid import matrix_to_quat
from plop.parameters import short_number, with_unit
from plop.planning.motions import Change, Motion
from plop.planning.plan import Planned
from plop.planning.power import LawPower
from plop.planning.result import Plan, Separation, Step

TEXT = "protocol.md"
_COLUMNS = "time_s,x_m,y_m,z_m,qw,qx,qy,qz"


def plan_of(found: Planned, *, diagnosed: bool, again: bool, environment: str) -> Plan:
    """Make the protocol.

    Args:
        found: What would be seen, and which motion distinguishes.
        diagnosed: The recordings to explain have been made: only the motion that distinguishes is recorded.
        again: The motion that distinguishes is recorded in the reference, too.
        environment: Of the recordings.
    """
    steps = _steps(found, diagnosed, again)
    rounds = tuple(
        tuple(step.motion for step in steps if step.repeats > turn)
        for turn in range(max((step.repeats for step in steps), default=0))
    )
    kept = Plan(
        "",
        tuple(found.laws),
        tuple(found.ways),
        found.separation,
        tuple(steps),
        rounds,
        tuple(motion.name for motion in found.motions),
        found.dropped,
        environment,
    )
    return replace(kept, text=plan_text(kept, diagnosed))


def _steps(found: Planned, diagnosed: bool, again: bool) -> list[Step]:
    """List the motions, those that leave the object whole first."""
    by_name = {motion.name: motion for motion in found.motions}
    repeats = 0 if diagnosed else _repeats(found)
    counts = {name: (repeats, max(repeats - 1, 0)) for name in by_name if repeats}
    if found.best is not None and found.separation is not None:
        by_name.setdefault(found.best.name, found.best)
        own, more = counts.get(found.best.name, (0, 0)), found.separation.repeats
        counts[found.best.name] = (own[0] + more, own[1] + more * again)
    steps = [
        Step(name, by_name[name].like, by_name[name].change, *count, _file(by_name[name]))
        for name, count in counts.items()
    ]
    return sorted(steps, key=lambda step: "cut" in by_name[step.motion].kind)


def _repeats(found: Planned) -> int:
    """Choose the least number of repeats with which all laws are seen that can be seen; of those asked for, if any."""
    asked = () if found.separation is None else found.separation.laws
    laws = [law for law in found.laws if not asked or law.effect in asked]
    return max((law.repeats for law in laws if law.repeats is not None), default=1)


def _file(motion: Motion) -> str:
    return "" if motion.change == Change.NONE else f"motions/{motion.like}-{motion.change.name.lower()}.csv"


def write_plan(kept: Plan, best: Motion | None, folder: Path) -> None:
    """Write plan.json, the text, and the tool's path of a motion that was not recorded."""
    kept.write(folder)
    lines = [kept.text, *(f"{k}. {', '.join(turn)}" for k, turn in enumerate(kept.rounds, 1))]
    write_text(folder / TEXT, "\n\n".join(lines[:1]) + "\n\n" + "\n".join(lines[1:]) + "\n")
    if best is None or best.change == Change.NONE:
        return
    (folder / "motions").mkdir(exist_ok=True)
    poses = best.tool.world_from_tool
    quats = matrix_to_quat(torch.from_numpy(poses[:, :3, :3])).numpy()
    rows = np.concatenate([best.tool.times[:, None], poses[:, :3, 3], quats], 1)
    text = "\n".join(",".join(f"{value:.6f}" for value in row) for row in rows)
    write_text(folder / _file(best), f"{_COLUMNS}\n{text}\n")


def plan_text(kept: Plan, diagnosed: bool) -> str:
    """Write the plan in words."""
    parts = [] if diagnosed else [_seen(kept)]
    if kept.separation is not None:
        parts.append(_separated(kept.separation))
    parts.append(_record(kept, diagnosed))
    return " ".join(parts)


def _seen(kept: Plan) -> str:
    """Say which laws would be seen."""
    known = [_limit(law) for law in kept.laws if law.amplitude is not None]
    start = (
        f"Seen nine times in ten if each of the {len(kept.episodes)} motions is repeated once: {'; '.join(known)}."
        if known
        else "No law would be seen if the motions are repeated once."
    )
    tried = len(kept.ways)
    counts = {count: [law.effect for law in kept.laws if law.repeats == count] for count in range(1, tried + 1)}
    times = [f"{_often(count)} in each set: {', '.join(laws)}" for count, laws in counts.items() if laws]
    never = [law.effect for law in kept.laws if law.repeats is None]
    if never:
        times.append(f"not even {_often(tried)}: {', '.join(never)}")
    return f"{start} At typical amplitudes, each motion recorded {'; '.join(times)}."


def _often(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _limit(law: LawPower) -> str:
    return f"{law.effect} from {with_unit(short_number(abs(law.amplitude or 0)), law.unit)} on"


def _separated(found: Separation) -> str:
    laws, count = " from ".join(found.laws), len(found.choices)
    left = f"(without, in {100 * found.chance:.0f} %)"
    often = f"recorded {_often(found.repeats)} it tells in {100 * found.settled:.0f} % of cases {left}"
    if found.settled >= RULE.seen:
        return f"Of {count} motions, '{found.motion}' distinguishes {laws} with the fewest recordings: {often}."
    return (
        f"None of {count} motions distinguishes {laws} nine times in ten, recorded as often as was tried. "
        f"'{found.motion}' comes nearest: {often}, so that they may well stay confounded."
    )


def _record(kept: Plan, diagnosed: bool) -> str:
    """Say what to record, in which order, and what then."""
    total, rounds = sum(step.repeats for step in kept.steps), len(kept.rounds)
    more, paths = sum(step.reference for step in kept.steps), [step.file for step in kept.steps if step.file]
    what = f"Record {total} episode{'s' * (total > 1)} of the object to explain"
    if more:
        what += f", and {more} more of the reference object"
    what += f", in {rounds} round{'s' * (rounds > 1)}, each motion once a round"
    if paths:
        what += f" (new path: {', '.join(paths)})"
    order = "so that heat and drying fall on all motions alike; a motion that cuts comes last, with a new object."
    then = (
        "Add them to the recordings that there are, and diagnose again."
        if diagnosed
        else "Then `plop diagnose --model base --recordings NEW --reference OLD`."
    )
    return f"{what}, {order} {then}"
