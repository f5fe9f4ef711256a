"""What a command needs besides what the user named: made on the way, or found where it is there already.

The commands that compare a model with measurements take a model and recordings. Gaussians, tracks and rollouts
of these recordings, the recordings that the model was made from, and the engine beside a learned model follow
from the two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import LEFT_OUT, closure, parents
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import execute, plan
from plop.pipeline.inputs import fitting
from plop.pipeline.listener import Listener, Silent
from plop.pipeline.registry import commands, stage_ref
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import SETTINGS_FILE, read_settings_file
from plop.pipeline.stage import Input, Stage

RECORDINGS = ("calibrate", "ingest", "simulate")
"""Stages whose artifacts are recordings, the most advanced first."""
MODELS = ("augment", "identify", "train")


class WouldRun(Exception):
    """Something is missing, and nothing may be made."""


@dataclass
class Preparation:
    """Makes what is missing, with the settings of the workspace."""

    store: Store
    listener: Listener = field(default_factory=Silent)
    exclude: tuple[str, ...] = ()
    """Cameras that tracks leave out."""
    may_run: bool = True
    """Make what is missing; else it is only noted."""
    would_run: dict[str, str] = field(default_factory=dict)
    """What was noted: input -> command that makes it."""

    def inputs(
        self, stage: Stage, given: Mapping[str, str | Path], environment: str | None, config: Any = None
    ) -> dict[str, str | Path]:
        """Complete the inputs of a stage.

        Args:
            stage: The stage that will run.
            given: What the user named.
            environment: Choose recordings of this environment where none are named.
            config: The stage's settings; None takes the defaults.

        Raises:
            PlopError: No recordings or no model are named or can be guessed, the stage refuses them, or a stage on the
                way fails.
        """
        found = dict(given)
        if "model" in stage.inputs and "model" not in found and not stage.inputs["model"].optional:
            found["model"] = self.only(MODELS, environment, "model").address
        if "recordings" not in found:
            found["recordings"] = self.only(RECORDINGS, environment, "recordings").address
        model = self.store.find(str(found["model"])) if "model" in found else None
        if "reference" in stage.inputs and "reference" not in found and model is not None:
            self._reference(found, model)
        self._fit_of_tracks(found)
        self.check_inputs(stage, found, stage.config() if config is None else config)
        for name, spec in stage.inputs.items():
            source = found.get(spec.along) if spec.along else None
            if name not in found and source not in (None, LEFT_OUT):
                recordings = self.store.find(str(source))
                fit = found.get(name.replace("tracks", "init")) if name.endswith("tracks") else None
                self.reach(found, name, spec.stages[0], self._making(spec.stages[0], recordings, model, fit))
            elif spec.along and name not in found and spec.optional:
                found[name] = LEFT_OUT
        if "engine" in stage.inputs and "engine" not in found:
            self.reach(found, "engine", "identify", lambda: self._engine(found, model))
        if "model" not in stage.inputs:
            found.pop("model", None)
        return found

    def check_inputs(self, stage: Stage, found: Mapping[str, str | Path], config: Any) -> None:
        """Let the stage refuse what is there before anything is made from it."""
        named = {
            name: fitting(self.store, stage, name, spec, str(found[name]))
            for name, spec in stage.inputs.items()
            if found.get(name, LEFT_OUT) != LEFT_OUT and spec.stages
        }
        if stage.check_inputs is not None:
            stage.check_inputs({name: Input(a.path, a.manifest) for name, a in named.items()}, config)

    def _making(
        self, command: str, recordings: Artifact, model: Artifact | None, fit: str | Path | None = None
    ) -> Callable[[], str]:
        return lambda: self.derived(command, recordings, model, fit).address

    def reach(self, found: dict[str, str | Path], name: str, command: str, make: Callable[[], str]) -> None:
        """Add an input that is made on the way, or note that it would be.

        Args:
            found: Receives the address.
            name: The input.
            command: What makes it.
            make: Makes or finds it, and gives its address.
        """
        try:
            found[name] = make()
        except WouldRun:
            self.would_run[name] = command

    def _fit_of_tracks(self, found: dict[str, str | Path]) -> None:
        """Take the fit that given tracks were made from: those of another are other Gaussians."""
        for prefix in ("", "reference_"):
            tracks, init = f"{prefix}tracks", f"{prefix}init"
            if tracks in found and init not in found and found[tracks] != LEFT_OUT:
                key = parents(self.store.find(str(found[tracks]))).get("init")
                if key in self._known():
                    found[init] = "@".join(key)

    def _reference(self, found: dict[str, str | Path], model: Artifact) -> None:
        """Take the recordings that the model was made from, unless they are those to be explained."""
        source = self.source_of(model)
        asked = self.store.find(str(found["recordings"]))
        same = source is None or source.key == asked.key or source.key in closure(self._known(), asked)
        found["reference"] = LEFT_OUT if same or source is None else source.address

    def source_of(self, model: Artifact) -> Artifact | None:
        """Give the recordings that a model was made from; None when they are gone.

        An added effect was fitted to other recordings than the base: the base's are meant.
        """
        known = self._known()
        while model.key[0] == "augment" and (base := parents(model).get("model")) in known:
            model = known[base]
        keys = closure(known, model)
        for name in RECORDINGS:
            for key in keys:
                if key[0] == name and key in known:
                    return known[key]
        return None

    def _engine(self, found: Mapping[str, str | Path], model: Artifact | None) -> str:
        """Fit an engine to the recordings of a learned model; an engine needs no second one."""
        from plop.models import engine_of

        if model is None or engine_of(model.path) is not None:
            return LEFT_OUT
        source = self.source_of(model)
        if source is None:
            return LEFT_OUT
        return self.derived("identify", source, None).address

    def derived(
        self, command: str, recordings: Artifact, model: Artifact | None, fit: str | Path | None = None
    ) -> Artifact:
        """Make one artifact of some recordings, and before it what it needs; `fit`: the Gaussians that are tracked."""
        inputs: dict[str, str | Path] = {"recordings": recordings.address}
        extra: dict[str, Any] = {}
        if command == "fit-init":
            inputs["clouds"] = self.derived("fuse", recordings, None).address
        if command in ("filter", "identify", "rollout", "eval", "compare"):
            inputs["init"] = fit or self.derived("fit-init", recordings, None).address
        if command == "filter":
            inputs["model"] = LEFT_OUT
            extra = {"exclude": list(self.exclude)}
        if command == "rollout":
            extra = self._split(recordings)
        if command == "eval":
            inputs["rollouts"] = self.derived("rollout", recordings, model).address
        if command in ("identify", "compare"):
            inputs["tracks"] = self.derived("filter", recordings, None).address
        if command in ("rollout", "compare") and model is not None:
            inputs["model"] = model.address
        return self._made(command, inputs, extra)

    def diagnosed(
        self, model: Artifact, recordings: Artifact, effect: str, files: Mapping[str, str | Path]
    ) -> Artifact:
        """Diagnose a model by some recordings; with one effect only, where it is named."""
        stage = stage_ref("diagnose").load()
        given = {"model": model.address, "recordings": recordings.address, **files}
        extra = {"effects": [effect]} if effect else {}
        return self._made("diagnose", self.inputs(stage, given, None), extra)

    def _split(self, recordings: Artifact) -> dict[str, Any]:
        """Take all episodes of recordings that have none for testing, unless the workspace's settings say which."""
        from plop.recordings.set import RecordingSet

        if RecordingSet.load(recordings.path).test or "split" in self._settings("rollout"):
            return {}
        self.listener.warn(f"{recordings.address} has no test episode: all its episodes are rolled out and scored")
        return {"split": "all"}

    def _settings(self, command: str) -> Mapping[str, Any]:
        return read_settings_file(self.store.workspace / SETTINGS_FILE, commands()).get(command, {})

    def _made(self, command: str, inputs: Mapping[str, str | Path], extra: Mapping[str, Any]) -> Artifact:
        stage = stage_ref(command).load()
        config = resolve(stage.config, command, (SETTINGS_FILE, self._settings(command)), ("plop", dict(extra)))
        if not self.may_run:
            there = plan(stage, store=self.store, config=config, inputs=inputs).existing
            if there is None:
                raise WouldRun(command)
            return there
        with self.listener.progress(command) as progress:
            outcome = execute(
                stage,
                store=self.store,
                config=config,
                inputs=inputs,
                progress=progress,
                on_wait=lambda pid: self.listener.waits(command, pid),
                on_start=self.listener.starts,
            )
        self.listener.finished(command, outcome)
        return outcome.artifact

    def only(self, stages: tuple[str, ...], environment: str | None, what: str) -> Artifact:
        """Take the latest artifact when there is no doubt which is meant."""
        pool = [a for a in self.store.artifacts(*stages) if environment in (None, a.manifest.environment)]
        if len({a.manifest.environment for a in pool}) != 1 or (
            what == "recordings" and len(pool) > 1 and len({a.key[0] for a in pool}) == 1
        ):
            if not pool and (reason := self.store.passed_over(*stages)) is not None:
                raise reason
            raise PlopError(
                f"Which {what}?",
                where=self.store.root,
                expected=f"--{what} NAME",
                found=", ".join(a.address for a in pool) or f"no {what} in this workspace",
                fix="`plop status` lists what there is.",
            )
        self.store.warn_passed_over(*stages, taken=pool[-1])
        return pool[-1]

    def _known(self) -> dict[tuple[str, str], Artifact]:
        return {a.key: a for a in self.store.artifacts()}


def takes_model_instead(stage: Stage) -> bool:
    """Tell whether a stage works on rollouts, which the user may leave to be made by naming a model."""
    return "rollouts" in stage.inputs and "model" not in stage.inputs


def wants_preparation(stage: Stage, given: Mapping[str, Any]) -> bool:
    """Tell whether a stage has inputs that follow from what was given."""
    derived = any(spec.along for spec in stage.inputs.values())
    return derived and ("model" in given or not takes_model_instead(stage))
