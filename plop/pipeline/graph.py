"""The graph of the pipeline, derived from the declared inputs of the stages; defined nowhere else."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from plop.pipeline.registry import StageRef, pipeline
from plop.pipeline.stage import Choice, InputSpec


class Graph:
    """The producers of the stages' inputs."""

    def __init__(self, refs: Sequence[StageRef] | None = None) -> None:
        """Create the graph of stages in the order of the pipeline; of all stages when absent."""
        self.refs = tuple(pipeline() if refs is None else refs)

    def maker(self, spec: InputSpec) -> StageRef:
        """Return the default producer of a missing input: the first stage that can make it."""
        return next(ref for ref in self.refs if ref.name == spec.stages[0])

    def chain(self, target: str, *, begin: str, also: Collection[str] = ()) -> dict[str, dict[str, str]]:
        """Return the chain of stages from raw data to an artifact, each once, each after those that it needs.

        Args:
            target: Command of the last stage, e.g. "eval".
            begin: Command that reads the raw data, e.g. "ingest mesh".
            also: Optional inputs to make although they have no recipe, e.g. "train.engine".

        Returns:
            Command -> {input: command that makes it}.

        Raises:
            ValueError: The declarations form a cycle.
        """
        commands = {ref.command: ref for ref in self.refs}
        found: dict[str, dict[str, str]] = {}

        def visit(command: str, above: tuple[str, ...]) -> None:
            if command in above:
                raise ValueError(f"the stages' inputs form a cycle: {' -> '.join((*above, command))}")
            if command in found:
                return
            sources = {}
            for name, spec in commands[command].load().inputs.items():
                made = spec.recipe is not None and spec.choice is not Choice.NAMED
                wanted = not spec.optional or made or f"{command}.{name}" in also
                if spec.stages and spec.read and wanted:
                    sources[name] = self._beginning_with(commands[begin], spec)
                    visit(sources[name], (*above, command))
            found[command] = sources

        visit(target, ())
        return found

    def _beginning_with(self, begin: StageRef, spec: InputSpec) -> str:
        """Choose the default producer of an input; of those that read raw data only the first of the chain."""
        for name in spec.stages:
            if name == begin.name:
                return begin.command
            ref = next(ref for ref in self.refs if ref.name == name)
            if any(source.stages and not source.optional for source in ref.load().inputs.values()):
                return ref.command
        raise ValueError(f"no chain that begins with {begin.command} makes what only {', '.join(spec.stages)} make")
