"""The graph of the pipeline, read from the inputs that the stages declare; written down nowhere else."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from plop.pipeline.registry import StageRef, pipeline
from plop.pipeline.stage import InputSpec


class Graph:
    """Which stage makes what another one needs."""

    def __init__(self, refs: Sequence[StageRef] | None = None) -> None:
        """Take stages in the order of the pipeline; all that there are without."""
        self.refs = tuple(pipeline() if refs is None else refs)

    def maker(self, spec: InputSpec) -> StageRef:
        """Give the stage by which an input is made on the way: the first of those that can."""
        return next(ref for ref in self.refs if ref.name == spec.stages[0])

    def chain(self, target: str, *, begin: str, also: Collection[str] = ()) -> dict[str, dict[str, str]]:
        """Give what makes an artifact from raw data, each stage once, each after those that it needs.

        Args:
            target: Command of the last stage, e.g. "eval".
            begin: Command that reads the raw data, e.g. "ingest mesh".
            also: Optional inputs that are made although no recipe does it, e.g. "train.engine".

        Returns:
            Command -> {input: command that makes it}.

        Raises:
            ValueError: The declarations go in a circle.
        """
        commands = {ref.command: ref for ref in self.refs}
        found: dict[str, dict[str, str]] = {}

        def visit(command: str, above: tuple[str, ...]) -> None:
            if command in above:
                raise ValueError(f"the stages' inputs go in a circle: {' -> '.join((*above, command))}")
            if command in found:
                return
            sources = {}
            for name, spec in commands[command].load().inputs.items():
                wanted = not spec.optional or spec.recipe is not None or f"{command}.{name}" in also
                if spec.stages and spec.read and wanted:
                    sources[name] = self._beginning_with(commands[begin], spec)
                    visit(sources[name], (*above, command))
            found[command] = sources

        visit(target, ())
        return found

    def _beginning_with(self, begin: StageRef, spec: InputSpec) -> str:
        """Choose the usual stage of an input; of those that read raw data only the one that a chain begins with."""
        for name in spec.stages:
            if name == begin.name:
                return begin.command
            ref = next(ref for ref in self.refs if ref.name == name)
            if any(source.stages and not source.optional for source in ref.load().inputs.values()):
                return ref.command
        raise ValueError(f"no chain that begins with {begin.command} makes what only {', '.join(spec.stages)} make")
