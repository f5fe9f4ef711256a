"""Missing physics through cameras: what a user types.

`plop simulate` hides something and films it with six noisy depth cameras, `plop diagnose` fits Gaussians, follows them
and judges, against an engine of another discretisation and another elastic law that `plop identify` fitted to
recordings in which nothing is hidden. Settings are those of `make demo-physics` (six episodes), but for the engine,
which is as fine as `identify` makes it by itself.
"""

from __future__ import annotations

import importlib.resources
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.missing_physics.plan import Run, cameras_plan
from benchmarks.missing_physics.row import Group, Row, judged
from benchmarks.missing_physics.runner import unreachable
from benchmarks.workspace import Typed
from plop.physics.effects.library import library
from plop.physics.scenes.hidden import SignalTooWeak
from plop.physics.scenes.sealed import open_answer
from plop_cli.demo_physics import PROFILE

FINER = ("--spacing-m", "0", "--iterations", "5")
"""The defaults of `identify`, which the demo's settings replace by half as many particles."""
ROUGH = ("--depth-noise-m", "0.002", "--arm-m", "0.02")
"""Bad cameras: four times the noise of depth, and an arm that holds the tool and hides part of every view."""
_SHARES = (1.0, 0.5)
"""Of the wanted signal that are tried, one after the other: many laws cannot move the block by 2 mm."""


class Cameras(Typed):
    """The benchmark through cameras, in one workspace."""

    def __init__(self, work: Path, plan: Sequence[Run] | None = None, recorded: tuple[str, ...] = ()) -> None:
        """Choose the workspace, the plan, and how recordings are made besides, as typed after `simulate`."""
        super().__init__(work, (importlib.resources.files("plop.pipeline") / "profiles" / PROFILE).read_text())
        self.work, self.plan, self.recorded = work, cameras_plan() if plan is None else plan, recorded

    def prepare(self) -> None:
        """Film recordings in which nothing is hidden and fit the engine to them."""
        self.plop("simulate", "block.toml", "--seed", "100", "--name", "plain", *self.recorded)
        self.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base", *FINER)

    def carry_out(self, run: Run, earlier: Row | None) -> Row:
        """See `Benchmark`; the answer is opened only after the verdict."""
        if not any(self.filmed(run, share) for share in _SHARES):
            return unreachable(run)
        found = self.diagnosed(run, "base", run.name)
        later: dict[str, Any] = self.next_round(run, found) if run.group is Group.PAIR else {}
        answer = open_answer(self.store.find(run.name).path)
        base = json.loads((self.store.find("base").path / "model.json").read_text())["estimates"]
        return Row(
            run.name,
            run.group,
            run.seed,
            answer["effects"],
            answer["snr"],
            wanted=run.snr,
            fault=run.fault or None,
            base={name: entry["value"] for name, entry in base.items()},
            rms_mm=1000 * answer["rms_m"],
            **judged(found, answer["effects"]),
            **later,
        )

    def filmed(self, run: Run, share: float) -> bool:
        """Make the recordings with a share of the signal; False where no amplitude in its range gives it."""
        words = ["simulate", "block.toml", "--seed", str(run.seed), "--name", run.name, *self.recorded]
        words += [word for text in run.typed() for word in ("--hide", text)]
        words += ["--snr", f"{share * run.snr:g}"] if run.snr else []
        words += ["--fault", run.fault] if run.fault else []
        try:
            self.plop(*words)
        except SignalTooWeak:
            return False
        return True

    def diagnosed(self, run: Run, model: str, name: str) -> dict[str, Any]:
        """Give what `plop diagnose` wrote."""
        kept = [word for law in library() if run.without and law != run.without for word in ("--effects", law)]
        self.plop("diagnose", "--model", model, "--recordings", run.name, "--name", f"verdict-{name}", *kept)
        return dict(json.loads((self.store.find(f"verdict-{name}").path / "diagnosis.json").read_text()))

    def next_round(self, run: Run, found: dict[str, Any]) -> dict[str, Any]:
        """Add what was named first, and diagnose again."""
        if not found["verdict"]["named"]:
            return {"next_named": []}
        name, model = found["verdict"]["named"][0], f"better-{run.name}"
        self.plop("augment", "--model", "base", "--effect", name, "--diagnosis", f"verdict-{run.name}", "--name", model)
        verdict = self.diagnosed(run, model, model)["verdict"]
        return {"next_verdict": verdict["kind"], "next_named": verdict["named"]}
