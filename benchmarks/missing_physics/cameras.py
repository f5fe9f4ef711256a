"""Missing physics through cameras: what a user types.

`plop simulate` hides something and films it with six depth cameras; `plop diagnose` fits Gaussians, follows them and
judges, against an engine of another discretisation and another elastic law that `plop identify` fitted to recordings
in which nothing is hidden. Settings are those of `make demo-physics`, but for the engine, which is as fine as
`identify` makes it by itself. The answer is opened only after the verdict.
"""

from __future__ import annotations

import importlib.resources
import json
import time
from pathlib import Path
from typing import Any

from benchmarks.missing_physics.plan import Set
from benchmarks.missing_physics.points import LEAST_SNR
from benchmarks.workspace import Typed
from plop.errors import SignalTooWeakError
from plop.physics.effects.library import library
from plop.physics.scenes.sealed import open_answer
from plop_cli.demo_physics import PROFILE
from stages.diagnose.stage import STAGE

FINER = ("--spacing-m", "0", "--iterations", "5")
"""The defaults of `identify`, which the demo's settings replace by half as many particles."""
SNRS = ("4", "2")
"""Wanted signals, tried one after the other: many laws cannot move the block by 2 mm."""


class Cameras:
    """One workspace for each base."""

    def __init__(self, work: Path) -> None:
        self.work = work

    def row(self, one: Set) -> dict[str, Any]:
        """Hide, film, judge, and only then compare."""
        started, loop = time.process_time(), workspace(self.work / f"cameras-{one.seed}")
        loop.plop("simulate", "block.toml", "--seed", str(one.seed), "--name", "plain")
        loop.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base", *FINER)
        if not film(loop, one):
            verdict: dict[str, Any] = {"kind": "-", "named": [], "evidence": {}}
            return {**one._asdict(), "group": "unreachable", "said": {"reference": {"verdict": verdict}}, "snr": 0.0}
        left_out = [law for law in library() if one.group == "outside" and law != one.law]
        kept = [word for law in left_out for word in ("--effects", law)]
        loop.plop("diagnose", "--model", "base", "--recordings", one.name, "--name", f"verdict-{one.name}", *kept)
        found = json.loads((loop.store.find(f"verdict-{one.name}").path / "diagnosis.json").read_text())
        said = {key: found[key] for key in ("verdict", "searches", "error", "floor")}
        answer = open_answer(loop.store.find(one.name).path)
        weak = one.group in ("single", "pair", "outside") and answer["snr"] < LEAST_SNR
        return {
            **one._asdict(),
            "group": f"{one.group} below" if weak else one.group,
            "said": {"reference": {**said, "ranking": found["ranking"][:3]}},
            "truth": answer["effects"],
            "snr": answer["snr"],
            "judged_by": STAGE.version,
            "cpu_s": round(time.process_time() - started, 1),
        }


def workspace(folder: Path) -> Typed:
    """Make a workspace with the settings of the demo."""
    return Typed(folder, (importlib.resources.files("plop.pipeline") / "profiles" / PROFILE).read_text())


def film(loop: Typed, one: Set) -> bool:
    """Make the recordings; False where no amplitude in a law's range gives the signal."""
    words = ["simulate", "block.toml", "--seed", str(one.seed + 500_000), "--name", one.name]
    words += ["--motions-seed", str(one.seed)] if one.repeated else []
    if one.group in ("null", "sensor"):
        loop.plop(*words, *(("--fault", one.law) if one.law else ()))
        return True
    words += [word for law in one.law.split("+") for word in ("--hide", law)]
    for snr in SNRS:
        try:
            loop.plop(*words, "--snr", snr)
        except SignalTooWeakError:
            continue
        return True
    return False
