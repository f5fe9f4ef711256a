"""Inputs of a stage that the user did not name: found if they exist, otherwise planned as runs that make them.

How each input is found or made is declared with the stage (`InputSpec`); this module knows no stage by name.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from plop.artifacts.fingerprint import plain
from plop.artifacts.lineage import Key, check_lineage, closure, parents
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import plan
from plop.pipeline.graph import Graph
from plop.pipeline.inputs import latest_inputs, named_input, undoubted
from plop.pipeline.listener import Listener, Silent
from plop.pipeline.registry import StageRef, commands
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import SETTINGS_FILE, read_settings_file
from plop.pipeline.stage import Choice, Input, InputSpec, Origin, Recipe, Stage
from plop.pipeline.tasks import Need, Task, addresses, given, needs, there


class Planner:
    """Plans runs with the settings of a workspace; runs nothing."""

    def __init__(self, store: Store, listener: Listener | None = None, graph: Graph | None = None) -> None:
        self.store, self.listener, self.graph = store, listener or Silent(), graph or Graph()
        self._tasks: dict[str, Task] = {}

    @cached_property
    def known(self) -> dict[Key, Artifact]:
        """All artifacts of the workspace.

        Raises:
            PlopError: One of them descends from itself.
        """
        found = {a.key: a for a in self.store.artifacts()}
        check_lineage(found)
        return found

    def task(
        self,
        ref: StageRef,
        config: Any,
        named: Mapping[str, str | Path],
        *,
        environment: str | None = None,
        name: str | None = None,
        force: bool = False,
    ) -> Task:
        """Plan the run that the user requested.

        Args:
            ref: The stage.
            config: Its settings.
            named: Inputs named by the user: addresses and raw paths by input name.
            environment: Environment of inputs that are not named.
            name: Name for the artifact.
            force: Make it again although it exists.

        Raises:
            PlopError: An input is missing and cannot be made, or is ambiguous, or the stage rejects one.
        """
        stage = ref.load()
        found = {key: named_input(self.store, stage, key, value) for key, value in named.items()}
        return Task(ref, config, _Inputs(self, stage, config, found, environment).all(), name=name, force=force)

    def completed(self, ref: StageRef, config: Any, inputs: Mapping[str, Need], *, force: bool = False) -> Task:
        """Plan a run with known inputs; missing ones are made from them."""
        return Task(ref, config, _Inputs(self, ref.load(), config, inputs, None, exact=True).all(), force=force)

    def derived(self, ref: StageRef, inputs: Mapping[str, Need], settings: Mapping[str, Any], recipe: Recipe) -> Task:
        """Plan the run that makes an input of another stage; repeated requests return the same task."""
        stage = ref.load()
        written = read_settings_file(self.store.workspace / SETTINGS_FILE, commands()).get(ref.command, {})
        bound = {name: one for name, value in inputs.items() for need in needs(value) if (one := there(need))}
        defaults, why = recipe.defaults(bound) if recipe.defaults is not None else ({}, "")
        defaults = {key: value for key, value in defaults.items() if key not in written}
        if defaults:
            self.listener.warn(why)
        sources = (("plop", dict(defaults)), (SETTINGS_FILE, written), ("plop", dict(settings)))
        config = resolve(stage.config, ref.command, *sources)
        return self.shared(self.completed(ref, config, inputs))

    def shared(self, task: Task) -> Task:
        """Return an existing task with the same result, if there is one, and note whether its artifact exists."""
        named = given(addresses(task, {other: str(id(other)) for other in task.before}))
        facts = [task.ref.command, plain(task.config), {name: str(value) for name, value in named.items()}]
        same = self._tasks.setdefault(json.dumps(facts, sort_keys=True), task)
        if same is task and not task.waits and not task.force:
            keys = {other: "@".join(other.there.key) for other in task.before if other.there is not None}
            inputs = given(addresses(task, keys))
            stage, command = task.ref.load(), task.ref.command
            task.there = plan(stage, store=self.store, config=task.config, inputs=inputs, command=command).existing
        return same


class _Inputs:
    """The inputs of one stage during planning."""

    def __init__(
        self,
        planner: Planner,
        stage: Stage,
        config: Any,
        found: Mapping[str, Need],
        environment: str | None,
        *,
        exact: bool = False,
    ) -> None:
        """Start with the known inputs.

        Args:
            planner: Plans missing inputs.
            stage: The stage.
            config: Its settings.
            found: The known inputs; None for one that is left out.
            environment: Environment of inputs that are not named.
            exact: Make unknown inputs from known ones, instead of using the latest.
        """
        self.planner, self.stage, self.config, self.environment = planner, stage, config, environment
        self.found: dict[str, Need] = dict(found)
        self._named = frozenset(found)
        self._exact = exact
        self._open: list[str] = []

    def all(self) -> dict[str, Need]:
        """Find or plan every input that the stage reads.

        Raises:
            PlopError: An input is missing and cannot be made, or is ambiguous, or the stage rejects one.
        """
        self._settle()
        if not self._exact:
            self._look_up()
        for name, spec in self.stage.inputs.items():
            if isinstance(spec.choice, Origin):
                self._value(name)
        self._refuse()
        return {name: self._value(name) for name, spec in self.stage.inputs.items() if spec.read}

    def _settle(self) -> None:
        """Use the ancestors of known inputs: a fit is that of the given tracks."""
        known = self.planner.known
        for name in list(self.found):
            recipe = self.stage.inputs[name].recipe
            made = [one for need in needs(self.found[name]) if (one := there(need))]
            for theirs, own in recipe.inputs.items() if recipe and made else ():
                keys = dict.fromkeys(parents(one).get(theirs, ("", "")) for one in made)
                if isinstance(own, str) and own not in self.found and keys.keys() <= known.keys():
                    several = tuple(known[key] for key in keys)
                    self.found[own] = several if self.stage.inputs[own].many else several[0]

    def _look_up(self) -> None:
        """Find existing inputs: the latest matching ones, then unambiguous ones, then the ancestors of a model."""
        inputs, store = self.stage.inputs, self.planner.store
        open_names = [name for name, spec in inputs.items() if name not in self.found and spec.stages and spec.read]
        latest = [name for name in open_names if inputs[name].choice is Choice.LATEST and not self._is_asked_for(name)]
        makeable = [name for name in latest if inputs[name].recipe is not None]
        chosen: dict[str, Any] = {name: value for name, value in self.found.items() if not isinstance(value, Task)}
        self.found |= latest_inputs(store, self.stage, latest, chosen, self.environment, makeable)
        self._settle()
        for name in open_names:
            if name not in self.found and inputs[name].choice in (Choice.UNAMBIGUOUS, Choice.ANY_LINE):
                self.found[name] = undoubted(store, self.stage, name, self.environment)

    def _is_asked_for(self, name: str) -> bool:
        """Return whether the user named an input that is not read but from which this one is made."""
        inputs, recipe = self.stage.inputs, self.stage.inputs[name].recipe
        sources = {} if recipe is None else recipe.inputs
        return any(isinstance(own, str) and own in self._named and not inputs[own].read for own in sources.values())

    def _refuse(self) -> None:
        """Let the stage check existing inputs before anything is made from them; others are checked when they run."""
        there = self._there()
        needed = [name for name, spec in self.stage.inputs.items() if not (spec.optional or spec.recipe)]
        if self.stage.check_inputs is not None and all(name in there for name in needed):
            self.stage.check_inputs(there, self.config)

    def _there(self) -> dict[str, Input]:
        found = {}
        for name, value in self.found.items():
            single = there(value) if isinstance(value, (Task, Artifact)) else None
            if single is not None:
                found[name] = Input(single.path, single.manifest)
            elif isinstance(value, Path):
                found[name] = Input(value)
            elif isinstance(value, tuple):
                several = ((k, there(one)) for k, one in enumerate(value))
                found |= {f"{name}.{k}": Input(one.path, one.manifest) for k, one in several if one is not None}
        return found

    def _value(self, name: str) -> Need:
        """Return an input: known, found now, or planned; None where it is left out."""
        spec = self.stage.inputs[name]
        if name not in self.found:
            if name in self._open:
                raise ValueError(f"the inputs of {self.stage.name} form a cycle: {', '.join(self._open)}")
            self._open.append(name)
            self.found[name] = self._new(name, spec)
            self._open.remove(name)
        value = self.found[name]
        if value is None and spec.read and not spec.optional:
            raise self._lacks(name)
        return value

    def _new(self, name: str, spec: InputSpec) -> Need:
        if isinstance(spec.choice, Origin):
            return self._origin(spec.choice)
        if spec.choice in (Choice.UNAMBIGUOUS, Choice.ANY_LINE):
            return undoubted(self.planner.store, self.stage, name, self.environment)
        recipe = spec.recipe
        if recipe is None or (recipe.needed is not None and not recipe.needed(self.config, self._there())):
            return None
        if spec.choice is Choice.MATCHING and (matching := self._matching(spec, recipe)):
            return matching if spec.many else matching[-1]
        return self._made(name, spec, recipe) if recipe.makes else None

    def _made(self, name: str, spec: InputSpec, recipe: Recipe) -> Need:
        """Plan the run that makes an input, once for each item of an input with several."""
        ref = self.planner.graph.maker(spec)
        bound = {theirs: self._bound(own) for theirs, own in recipe.inputs.items()}
        for theirs, own in recipe.inputs.items():
            if bound[theirs] is None and not ref.load().inputs[theirs].optional:
                if spec.optional:
                    return None
                raise self._lacks(own if isinstance(own, str) else name)
        settings = {} if recipe.settings is None else recipe.settings(self.config)
        count = max((len(value) for value in bound.values() if isinstance(value, tuple)), default=1)
        each = [{k: v[n] if isinstance(v, tuple) else v for k, v in bound.items()} for n in range(count)]
        tasks = tuple(self.planner.derived(ref, inputs, settings, recipe) for inputs in each)
        return tasks if spec.many else tasks[0]

    def _bound(self, own: str | Origin) -> Need:
        return self._origin(own) if isinstance(own, Origin) else self._value(own)

    def _origin(self, origin: Origin) -> Artifact | None:
        """Trace a model through its bases to the recordings that it was made from; None when they are gone."""
        known = self.planner.known
        value = self._value(origin.model)
        model = there(value) if isinstance(value, (Task, Artifact)) else None
        while model is not None and origin.model in parents(model):
            model = known.get(parents(model)[origin.model])
        source = None if model is None else known.get(parents(model).get(origin.input, ("", "")))
        if source is None or not origin.apart_from:
            return source
        asked = [one for need in needs(self._value(origin.apart_from)) if (one := there(need))]
        return None if any(source.key in closure(known, one) for one in asked) else source

    def _matching(self, spec: InputSpec, recipe: Recipe) -> tuple[Artifact, ...]:
        """Find artifacts that were made from the inputs of a recipe, as far as these are known."""
        inputs: dict[str, tuple[Artifact, ...]] = {}
        found = self.planner.store.artifacts(*spec.stages)
        for theirs, own in recipe.inputs.items():
            value = self._bound(own)
            inputs[str(own)] = tuple(one for need in needs(value) if (one := there(need)))
            keys = {one.key for one in inputs[str(own)]}
            if needs(value):
                found = [one for one in found if parents(one).get(theirs) in keys]
        return tuple(found if spec.select is None else spec.select(self.config, found, inputs))

    def _lacks(self, name: str) -> PlopError:
        spec = self.stage.inputs[name]
        option = f"--{name.replace('_', '-')}"
        return PlopError(
            f"`{self.stage.name}` needs the input {name!r}.",
            where=self.planner.store.root,
            expected=f"{option} {'NAME,NAME,...' if spec.many else 'NAME'}: {spec.help}",
            found="none",
            fix="`plop status` lists the artifacts.",
        )
