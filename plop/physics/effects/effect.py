"""Definition of an effect: one law with parameters that have units, a range, and a value that means 'absent'.

A law acts through the hooks below; each does nothing unless an effect overrides it. The engine calls them in every time
step with a `body`, whose arrays are those of `plop.physics.effects.body.Body`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from plop.parameters import Parameter, checked_values
from plop.physics.effects.body import Body
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.law import Hook, call, misused
from plop.physics.engine.material import Material

Kind = Literal["physics", "decoy", "base"]


class Effect:
    """Base of all effects; a subclass sets the class variables and overrides the hooks it needs.

    Args of the constructor are the values of the parameters, by name.

    Raises:
        PlopError: An unknown parameter, or a value that is out of range or not finite.
    """

    name: ClassVar[str]
    """Short name, as in commands, e.g. "viscosity"."""
    help: ClassVar[str]
    """Description in one line."""
    law: ClassVar[str]
    """The law as a formula in plain text, e.g. "tau += 2 eta dev(D)"."""
    source: ClassVar[str]
    """Source of the law."""
    kind: ClassVar[Kind] = "physics"
    """A decoy has no visible effect in slow motion and must not be named. "base" marks a parameter of every
    model (stiffness, damping, density): it is refitted beside an effect, and never called missing physics."""
    amplitudes: ClassVar[tuple[Parameter, ...]]
    """Numbers that are 0 when the effect is absent; the response is about linear in them while they are small."""
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    """Further numbers, e.g. a time constant or a direction; without effect while the amplitudes are 0."""
    variants: ClassVar[tuple[dict[str, float], ...]] = ({},)
    """Settings of the shape parameters at which the screen tries the effect."""
    acts_at_rest: ClassVar[bool] = True
    """Whether it changes how an object rests before its first frame: a law of the tool or of motion does not."""
    needs_blade: ClassVar[bool] = False
    """Whether it does nothing where the tool is no blade, which cuts nothing."""
    remembers: ClassVar[dict[str, tuple[tuple[int, ...], float]]] = {}
    """Arrays that the law stores per particle: name -> (shape after N, first value); in `body.memory` as
    "<effect>.<name>". The engine sorts, saves and restores them with the particles."""

    def __init__(self, **values: float) -> None:
        self.values = checked_values(
            "effect", self.name, self.parameters(), values, units="lengths are metres, stresses pascals"
        )

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """List all parameters, amplitudes first."""
        return (*cls.amplitudes, *cls.shapes)

    def __getitem__(self, parameter: str) -> float:
        """Value of one parameter."""
        return self.values[parameter]

    def __repr__(self) -> str:
        inner = ", ".join(f"{key}={value:g}" for key, value in self.values.items())
        return f"{self.name}({inner})"

    @property
    def absent(self) -> bool:
        """Return whether all amplitudes are 0."""
        return all(self.values[p.name] == 0 for p in self.amplitudes)

    def overrides(self, hook: Hook) -> bool:
        """Return whether the law's class overrides a hook of the time step."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def material(self, material: Material) -> Material:
        """Change the base's parameters before the run."""
        return material

    def config(self, config: EngineConfig) -> EngineConfig:
        """Change the engine's surroundings before the run."""
        return config

    def at_rest(self) -> Effect:
        """Return the law under which an object settles before its first frame: its long-time limit."""
        return self if self.acts_at_rest else type(self)()

    def before(self, body: Body, dt: float) -> None:
        """Act before a time step: forces change `body.v` in place."""

    def stress(self, body: Body, dt: float) -> None:
        """Add Kirchhoff stress to `body.extra`, float32 [N, 6] (xx, yy, zz, xy, xz, yz) [Pa], in place."""

    def after(self, body: Body, dt: float) -> None:
        """Act after a time step: flow rules change `body.f` and the effect's memory in place."""

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Return the longest stable time step of the law [s]; infinite when it sets no limit."""
        return np.inf


def at_rest(effects: Sequence[Effect]) -> list[Effect]:
    """Return the laws under which an object settles.

    Raises:
        PlopError: The hook raised an error or returned no effect.
    """
    given = [(effect, call(effect, "at_rest")) for effect in effects]
    for effect, resting in given:
        if not isinstance(resting, Effect) or resting.name != effect.name:
            raise misused(effect, "at_rest", f"an effect {effect.name}", repr(resting)[:80])
    return [resting for _, resting in given]
