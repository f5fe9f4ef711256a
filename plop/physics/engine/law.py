"""What the engine asks of a law that acts besides the material's own, and how it asks.

Kernels index the grid with positions and are compiled for finite numbers: whatever a law returns or changes is looked
at before it reaches them, and a mistake in a law of the user's is reported with its place, not as a broken run.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, TypeVar

import numpy as np

from plop.errors import PlopError, UserCodeError
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.user_code import line_of, user_error

if TYPE_CHECKING:
    from plop.physics.engine.engine import Engine

Hook = Literal["before", "stress", "after"]
"""Where in a time step a law can act."""

_CHANGES: dict[Hook, dict[str, tuple[int, ...]]] = {
    "before": {"v": (3,)},
    "stress": {"extra": (6,)},
    "after": {"x": (3,), "v": (3,), "f": (3, 3)},
}
"""What each hook may change, with the shape after N."""

Given = TypeVar("Given")


class Law(Protocol):
    """A law that acts in every time step; `plop.physics.effects.effect.Effect` is what laws are made from."""

    name: ClassVar[str]
    remembers: ClassVar[dict[str, tuple[tuple[int, ...], float]]]
    """Arrays kept per particle: name -> (shape after N, first value)."""

    @property
    def absent(self) -> bool:
        """Whether it would change nothing."""

    def overrides(self, hook: Hook) -> bool:
        """Tell whether it does something in a hook."""

    def material(self, material: Material) -> Material:
        """Change the base's parameters before the run."""

    def config(self, config: EngineConfig) -> EngineConfig:
        """Change the engine's surroundings before the run."""

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Give the longest stable time step [s]."""

    def before(self, body: Engine, dt: float) -> None:
        """Act before a time step [s]."""

    def stress(self, body: Engine, dt: float) -> None:
        """Add stress in a time step [s]."""

    def after(self, body: Engine, dt: float) -> None:
        """Act after a time step [s]."""


def call(law: Any, hook: str, *args: Any) -> Any:
    """Call a method of a law.

    Raises:
        PlopError: It raised; names the line in the file of the law.
    """
    try:
        return getattr(law, hook)(*args)
    except PlopError as error:
        if _of_the_library(law):
            raise
        raise misused(law, hook, error.expected or "-", f"{error.problem} {error.found}") from error
    except (Exception, SystemExit) as error:
        raise user_error(Path(inspect.getfile(type(law))), error) from error


def changed(law: Law, hook: Literal["material", "config"], given: Given) -> Given:
    """Call `material` or `config` and insist on getting what was given, changed.

    Raises:
        PlopError: The hook raised or gave something else.
    """
    result = call(law, hook, given)
    if not isinstance(result, type(given)):
        raise misused(law, hook, type(given).__name__, type(result).__name__)
    return result


def slowest_step_s(law: Law, material: Material, config: EngineConfig) -> float:
    """Ask a law for its longest time step [s].

    Raises:
        PlopError: The hook raised or gave no positive number.
    """
    result = call(law, "slowest_step_s", material, config)
    if not (isinstance(result, float | int | np.floating) and result > 0):
        raise misused(law, "slowest_step_s", "a positive time [s]", repr(result))
    return float(result)


def act(law: Law, hook: Hook, body: Engine, dt: float) -> str | None:
    """Call a hook of the time step and look at what it may have changed.

    Returns:
        What is wrong with the numbers, or None.

    Raises:
        PlopError: The hook raised, or put an array of another shape or type in place of one of the engine's.
    """
    call(law, hook, body, dt)
    for name, shape in _CHANGES[hook].items():
        values = getattr(body, name)
        expected = (len(body.number), *shape)
        if not isinstance(values, np.ndarray):
            raise misused(law, hook, f"body.{name} float32 {expected}, changed in place", type(values).__name__)
        if values.shape != expected or values.dtype != np.float32 or not values.flags.c_contiguous:
            raise misused(
                law, hook, f"body.{name} float32 {expected}, changed in place", f"{values.dtype} {values.shape}"
            )
        flat = values.reshape(-1)
        if not np.isfinite(flat @ flat):
            return f"the effect {_place(law, hook)} left a number in body.{name} that is not finite"
    return None


def misused(law: Any, hook: str, expected: str, found: str) -> PlopError:
    """Say what a method of a law should have given."""
    return UserCodeError(
        "A hook of an effect cannot be used.",
        where=_place(law, hook),
        expected=expected,
        found=found,
        fix="See the template in docs/how-to/write-an-effect.md.",
    )


def _place(law: Any, hook: str) -> str:
    """Name a hook, and the line of the user's file that sets it."""
    kind, name = type(law), f"{law.name}.{hook}"
    if _of_the_library(law):
        return name
    path = Path(inspect.getfile(kind))
    return f"{name} ({path}, line {line_of(kind, hook, path)})"


def _of_the_library(law: Any) -> bool:
    return type(law).__module__.startswith("plop.")
