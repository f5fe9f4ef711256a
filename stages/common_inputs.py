"""Common inputs of several stages: recordings, models, and inputs made from recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from plop.errors import PlopError
from plop.models import engine_of
from plop.pipeline.stage import Choice, Inputs, InputSpec, Origin, Recipe
from plop.recordings.set import RecordingSet
from plop.tracking.episode import Episode
from plop.tracking.sets import tracked_episodes
from stages import RECORDINGS


def recordings_input(help: str, choice: Choice = Choice.LATEST) -> InputSpec:
    """Declare recordings; `Choice.UNAMBIGUOUS` where a wrong guess would lead to a wrong verdict."""
    return InputSpec(RECORDINGS, help, choice=choice)


def init_input(help: str, of: str = "recordings", choice: Choice = Choice.MADE) -> InputSpec:
    """Declare the Gaussians of frame 0 of recordings, the input `of`."""
    return InputSpec(("fit-init",), help, choice=choice, recipe=Recipe({"recordings": of}))


def tracks_input(
    help: str, of: str = "recordings", init: str = "init", settings: Callable[[Any], Mapping[str, Any]] | None = None
) -> InputSpec:
    """Declare the filter's states of recordings, tracked from the Gaussians `init` without a model."""
    return InputSpec(
        ("filter",), help, choice=Choice.MADE, recipe=Recipe({"recordings": of, "init": init}, settings=settings)
    )


def measured_input(help: str, needed: Callable[[Any, Inputs], bool]) -> InputSpec:
    """Declare the filter's states of recordings, left out where they are not needed."""
    recipe = Recipe({"recordings": "recordings", "init": "init"}, needed=needed)
    return InputSpec(("filter",), help, optional=True, choice=Choice.NAMED, recipe=recipe)


def measured_episodes(
    inputs: Inputs, recordings: RecordingSet, names: list[str]
) -> tuple[list[Episode], dict[str, str]]:
    """Read the tracked points of episodes from the input `measured`; return also why others are left out.

    Raises:
        PlopError: There are no tracks, or none of these episodes is usable.
    """
    if "measured" not in inputs:
        raise PlopError(
            "A band needs measured points.",
            where="--measured",
            expected="an artifact of filter",
            found="none",
            fix="Run `plop filter` on these recordings.",
        )
    return tracked_episodes(recordings, inputs["init"].path, inputs["measured"].path, names)


def optional(spec: InputSpec) -> InputSpec:
    """Declare the same as an optional input."""
    return replace(spec, optional=True)


def engine_input(choice: Choice) -> InputSpec:
    """Declare the engine used with a learned model, fitted to the recordings that the model was trained on."""
    return InputSpec(
        ("identify",),
        "engine used with a learned model",
        optional=True,
        choice=choice,
        recipe=Recipe({"recordings": Origin()}, needed=_is_learned),
    )


def _is_learned(config: Any, inputs: Inputs) -> bool:
    return "model" in inputs and engine_of(inputs["model"].path) is None
