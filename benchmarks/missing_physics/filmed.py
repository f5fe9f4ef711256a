"""What is filmed for the benchmark: plop's own scenes, and the meshes of other simulators."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from benchmarks.missing_physics.cuts import Cuts
from benchmarks.missing_physics.makers import Foreign, Values
from benchmarks.missing_physics.plan import CAMERAS, Set
from benchmarks.missing_physics.points import Points
from benchmarks.workspace import Typed
from plop.artifacts.atomic_file import write_json
from plop.errors import SignalTooWeakError
from plop.physics.scenes.sealed import open_answer
from plop.recordings.readers.mesh.sequence import write_mesh_sequence
from plop.render.virtual_cameras.texture import seed_from

SNRS = ("4", "2")
"""Wanted signals, tried one after the other: many laws cannot move the block by 2 mm."""


class Filmed(Protocol):
    """Recordings of one set, made by commands in its workspace."""

    def plain(self) -> None:
        """Film the reference, as recordings "plain"."""

    def hidden(self) -> bool:
        """Film the set under its name; False where no amplitude in a law's range gives the signal."""

    def answer(self) -> dict[str, Any]:
        """Open the answer: effects with their amplitudes, and the SNR."""


@dataclass(frozen=True)
class Simulated:
    """Scenes of `plop simulate`."""

    loop: Typed
    one: Set

    def plain(self) -> None:
        """See `Filmed`."""
        self.loop.plop("simulate", "block.toml", "--seed", str(self.one.seed), "--name", "plain")

    def hidden(self) -> bool:
        """See `Filmed`."""
        one = self.one
        words = ["simulate", "block.toml", "--seed", str(one.seed + 500_000), "--name", one.name]
        words += ["--motions-seed", str(one.seed)] if one.repeated else []
        if one.group in ("null", "sensor"):
            self.loop.plop(*words, *(("--fault", one.law) if one.law else ()))
            return True
        words += [word for law in one.law.split("+") for word in ("--hide", law)]
        for snr in SNRS:
            try:
                self.loop.plop(*words, "--snr", snr)
            except SignalTooWeakError:
                continue
            return True
        return False

    def answer(self) -> dict[str, Any]:
        """See `Filmed`."""
        return open_answer(self.loop.store.find(self.one.name).path)


@dataclass(frozen=True)
class Meshes:
    """Surfaces of another simulator's object, filmed by `plop ingest mesh`."""

    loop: Typed
    one: Set

    def plain(self) -> None:
        """See `Filmed`."""
        self._film("plain", range(self._points.episodes), {})

    def hidden(self) -> bool:
        """See `Filmed`; a signal that is too weak for the goals is one all the same."""
        one, sensor = self.one, self.one.group == "sensor"
        if not self._answer.is_file():
            nothing = dict[str, Values](), dict[str, Values](), [], 0.0
            hidden, truth, _, snr = nothing if sensor else self._points.hidden(self._maker, one)
            numbers = range(one.first, one.first + self._points.episodes)
            self._film(one.name, numbers, hidden, *(("--fault", one.law) if sensor else ()))
            write_json(self._answer, {"effects": truth, "snr": snr})
        return True

    def answer(self) -> dict[str, Any]:
        """See `Filmed`."""
        return dict(json.loads(self._answer.read_text()))

    @property
    def _maker(self) -> Foreign:
        simulator = self.one.world.removesuffix(f"-{CAMERAS}")
        return Cuts(self.one.seed) if simulator == "disect" else Foreign(simulator, self.one.seed)

    @property
    def _points(self) -> Points:
        return Points(self.loop.workspace, jobs=1)

    @property
    def _answer(self) -> Path:
        return self.loop.workspace / f"{self.one.name}.json"

    def _film(self, name: str, numbers: Iterable[int], hidden: Mapping[str, Values], *words: str) -> None:
        raw, maker = self.loop.workspace / "raw" / name, self._maker
        if not raw.is_dir():
            part = raw.with_suffix(".part")
            shutil.rmtree(part, ignore_errors=True)
            for k in numbers:
                write_mesh_sequence(part, replace(maker.sequence(k, hidden), name=f"{name}_{k:03d}"))
            part.rename(raw)
        # the same object with the same pattern; the noise is that of an episode's name, also where a motion is repeated
        seed = str(seed_from("plain"))
        self.loop.plop("ingest", "mesh", str(raw), "--name", f"raw-{name}", "--seed", seed, *words)
        self.loop.plop("calibrate", "--recordings", f"raw-{name}", "--name", name)
