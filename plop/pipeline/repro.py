"""Remake stale artifacts, with the settings recorded in the manifests; similar to `dvc repro`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from plop.artifacts.lineage import Key
from plop.artifacts.stale import Stale, raw_path
from plop.artifacts.store import Artifact, Store
from plop.artifacts.succession import latest_lines, replacements
from plop.artifacts.verify import obvious_damage
from plop.errors import PlopError
from plop.pipeline.listener import Listener
from plop.pipeline.registry import commands
from plop.pipeline.settings_file import SETTINGS_FILE, read_settings_file
from plop.pipeline.stage import Stage
from plop.pipeline.staleness import recorded_config, ref_of, stale
from plop.pipeline.tasks import Need, Task
from plop.pipeline.upstream import Planner


class Renewal:
    """Plans the runs that remake stale artifacts, and all that has to be made before them."""

    def __init__(self, store: Store, listener: Listener | None = None) -> None:
        self.store = store
        self.artifacts = store.artifacts()
        self.names = store.names()
        self.stale: dict[Key, Stale] = stale(store, self.artifacts)
        self._known = {artifact.key: artifact for artifact in self.artifacts}
        self._planner = Planner(store, listener)
        self._tasks: dict[Key, Task] = {}

    def tasks(self, chosen: Sequence[Artifact] = ()) -> dict[Key, Task]:
        """Plan the runs.

        Args:
            chosen: Artifacts to remake with their ancestors; all stale ones of `plop status` when absent.

        Returns:
            Tasks by the artifact that they remake, each after those that it needs.

        Raises:
            PlopError: An input of an artifact is gone and cannot be made, or its stage or a setting no longer exists.
        """
        shown = [a for a in latest_lines(self.artifacts, self.names) if self._replacements[a.key] is a]
        for artifact in chosen or shown:
            self._renewed(artifact)
        return self._tasks

    def names_of(self, key: Key) -> list[str]:
        """Return the names of an artifact: they move to its replacement."""
        return [name for name, address in self.names.items() if address == "@".join(key)]

    @cached_property
    def _replacements(self) -> dict[Key, Artifact]:
        return replacements(self._known, self.names)

    def _renewed(self, artifact: Artifact) -> Artifact | Task:
        damaged = obvious_damage(artifact) is not None
        if artifact.key not in self._tasks:
            for name in artifact.manifest.inputs:
                self._input(artifact, name)  # its inputs may be damaged, which does not make it stale
            if artifact.key in self.stale or damaged:
                self._tasks[artifact.key] = self._again(artifact, force=damaged)
        return self._tasks.get(artifact.key, artifact)

    def _again(self, artifact: Artifact, *, force: bool) -> Task:
        ref = ref_of(artifact)
        if ref is None:
            raise PlopError(
                "The stage that made this artifact no longer exists.",
                where=artifact.path,
                expected=", ".join(commands()),
                found=artifact.manifest.stage,
                fix="`plop gc` removes it, unless it has a name.",
            )
        stage = ref.load()
        written = read_settings_file(self.store.workspace / SETTINGS_FILE, commands()).get(ref.command, {})
        try:
            config = recorded_config(artifact, stage, dict(written))
        except PlopError as error:
            raise PlopError(
                f"The settings of {artifact.address} are not those of this version: {error.problem}",
                where=artifact.path,
                expected=error.expected,
                found=error.found,
                fix=f"Run `plop {ref.command}` with valid settings.",
            ) from error
        inputs = self._inputs(artifact, stage)
        return self._planner.shared(self._planner.completed(ref, config, inputs, force=force))

    def _inputs(self, artifact: Artifact, stage: Stage) -> dict[str, Need]:
        """Return the present inputs of an artifact; those that are gone and can be made are left out."""
        found: dict[str, Need] = {name: None for name, spec in stage.inputs.items() if spec.read and spec.optional}
        several: dict[str, list[Artifact | Task]] = {}
        for name in artifact.manifest.inputs:
            base, _, number = name.partition(".")
            if base not in stage.inputs:
                continue  # of a version of the stage with this input
            value = self._input(artifact, name)
            if value is None:
                recipe = stage.inputs[base].recipe
                if (
                    number or recipe is None or not recipe.makes
                ):  # an optional one, too: without it the result would differ
                    raise self._gone(artifact, name)
                found.pop(base, None)
            elif number and not isinstance(value, Path):
                several.setdefault(base, []).append(value)
            else:
                found[base] = value
        return found | {name: tuple(value) for name, value in several.items()}

    def _input(self, artifact: Artifact, name: str) -> Artifact | Task | Path | None:
        facts = artifact.manifest.inputs[name]
        if "fingerprint" not in facts:
            return raw_path(self.store, artifact, name)
        source = self._known.get((str(facts["stage"]), str(facts["fingerprint"])))
        if source is not None:
            return self._renewed(self._replacements[source.key])
        same = [a for a in self.artifacts if a.key[0] == facts["stage"] and a.content == facts["content"]]
        return same[-1] if same else None

    def _gone(self, artifact: Artifact, name: str) -> PlopError:
        facts = artifact.manifest.inputs[name]
        what = f"{facts['stage']}@{str(facts['fingerprint'])[:8]}" if "stage" in facts else str(facts.get("name"))
        return PlopError(
            f"{artifact.address} cannot be made again: its {name} is gone.",
            where=self.store.root,
            expected=what,
            found="nothing",
            fix=f"Make its {name} again and run `plop {artifact.manifest.stage}` with it, or choose other artifacts to "
            "remake: `plop repro ADDRESS`.",
        )
