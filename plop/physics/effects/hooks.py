"""Call the hooks of effects so that a mistake in one is reported with its place, not as a broken run."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from plop.errors import PlopError, UserCodeError
from plop.physics.effects.declared import line_of
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import user_error

if TYPE_CHECKING:
    from plop.physics.engine.engine import Engine

_CHANGES: dict[str, dict[str, tuple[int, ...]]] = {
    "before": {"v": (3,)},
    "stress": {"extra": (6,)},
    "after": {"x": (3,), "v": (3,), "f": (3, 3)},
}
"""What each hook of a time step may change, with the shape after N."""

Given = TypeVar("Given")


def call(effect: Effect, hook: str, *args: Any) -> Any:
    """Call one hook.

    Raises:
        PlopError: The hook raised; names the line in the file of the effect.
    """
    try:
        return getattr(effect, hook)(*args)
    except PlopError as error:
        if _of_the_library(effect):
            raise
        raise _misused(effect, hook, error.expected or "-", f"{error.problem} {error.found}") from error
    except (Exception, SystemExit) as error:
        raise user_error(Path(inspect.getfile(type(effect))), error) from error


def changed(effect: Effect, hook: str, given: Given) -> Given:
    """Call `material` or `config` and insist on getting what was given, changed.

    Raises:
        PlopError: The hook raised or gave something else.
    """
    result = call(effect, hook, given)
    if not isinstance(result, type(given)):
        raise _misused(effect, hook, type(given).__name__, type(result).__name__)
    return result


def at_rest(effects: Sequence[Effect]) -> list[Effect]:
    """Give the laws under which an object comes to rest.

    Raises:
        PlopError: The hook raised or gave no effect.
    """
    given = [(effect, call(effect, "at_rest")) for effect in effects]
    for effect, resting in given:
        if not isinstance(resting, Effect) or resting.name != effect.name:
            raise _misused(effect, "at_rest", f"an effect {effect.name}", repr(resting)[:80])
    return [resting for _, resting in given]


def slowest_step_s(effect: Effect, *args: Any) -> float:
    """Ask an effect for its longest time step [s].

    Raises:
        PlopError: The hook raised or gave no positive number.
    """
    result = call(effect, "slowest_step_s", *args)
    if not (isinstance(result, float | int | np.floating) and result > 0):
        raise _misused(effect, "slowest_step_s", "a positive time [s]", repr(result))
    return float(result)


def act(effect: Effect, hook: str, body: Engine, dt: float) -> str | None:
    """Call a hook of the time step and look at what it may have changed.

    Kernels index the grid with positions and are compiled for finite numbers: nothing else may reach them.

    Returns:
        What is wrong with the numbers, or None.

    Raises:
        PlopError: The hook raised, or put an array of another shape or type in place of one of the engine's.
    """
    call(effect, hook, body, dt)
    for name, shape in _CHANGES[hook].items():
        values = getattr(body, name)
        expected = (len(body.number), *shape)
        if not isinstance(values, np.ndarray):
            raise _misused(effect, hook, f"body.{name} float32 {expected}, changed in place", type(values).__name__)
        if values.shape != expected or values.dtype != np.float32 or not values.flags.c_contiguous:
            raise _misused(
                effect, hook, f"body.{name} float32 {expected}, changed in place", f"{values.dtype} {values.shape}"
            )
        flat = values.reshape(-1)
        if not np.isfinite(flat @ flat):
            return f"the effect {_place(effect, hook)} left a number in body.{name} that is not finite"
    return None


def _misused(effect: Effect, hook: str, expected: str, found: str) -> PlopError:
    return UserCodeError(
        "A hook of an effect cannot be used.",
        where=_place(effect, hook),
        expected=expected,
        found=found,
        fix="See the template in docs/how-to/write-an-effect.md.",
    )


def _place(effect: Effect, hook: str) -> str:
    """Name a hook, and the line of the user's file that sets it."""
    kind, name = type(effect), f"{effect.name}.{hook}"
    if _of_the_library(effect):
        return name
    path = Path(inspect.getfile(kind))
    return f"{name} ({path}, line {line_of(kind, hook, path)})"


def _of_the_library(effect: Effect) -> bool:
    return type(effect).__module__.startswith("plop.physics.effects.")
