"""What an effect is: one law with parameters that have units, a range, and a value that means 'absent'.

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
    """Short name, as the user types it, e.g. "viscosity"."""
    help: ClassVar[str]
    """One line: what it is."""
    law: ClassVar[str]
    """The law as a formula in plain text, e.g. "tau += 2 eta dev(D)"."""
    source: ClassVar[str]
    """Where the law is from."""
    kind: ClassVar[Kind] = "physics"
    """A decoy is there to be refused: in slow motion it has no visible effect. "base" marks a parameter that
    every model has (stiffness, damping, density): to be refitted beside an effect, never to be called one."""
    amplitudes: ClassVar[tuple[Parameter, ...]]
    """Numbers that are 0 when the effect is absent; the response is about linear in them while they are small."""
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    """Further numbers, e.g. a time constant or a direction; without effect while the amplitudes are 0."""
    variants: ClassVar[tuple[dict[str, float], ...]] = ({},)
    """Settings of the shape parameters at which the screen tries the effect."""
    remembers: ClassVar[dict[str, tuple[tuple[int, ...], float]]] = {}
    """Arrays the law keeps per particle: name -> (shape after N, first value); in `body.memory` as
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
        """Tell whether all amplitudes are 0."""
        return all(self.values[p.name] == 0 for p in self.amplitudes)

    def overrides(self, hook: Hook) -> bool:
        """Tell whether the law's class has its own version of a hook of the time step."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def material(self, material: Material) -> Material:
        """Change the base's parameters before the run."""
        return material

    def config(self, config: EngineConfig) -> EngineConfig:
        """Change the engine's surroundings before the run."""
        return config

    def at_rest(self) -> Effect:
        """Give the law under which an object comes to rest before its first frame: as it acts after a long time."""
        return self

    def before(self, body: Body, dt: float) -> None:
        """Act before a time step: forces change `body.v` in place."""

    def stress(self, body: Body, dt: float) -> None:
        """Add Kirchhoff stress to `body.extra`, float32 [N, 6] (xx, yy, zz, xy, xz, yz) [Pa], in place."""

    def after(self, body: Body, dt: float) -> None:
        """Act after a time step: flow rules change `body.f` and the effect's memory in place."""

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Give the longest time step at which the law is stable [s]; infinite when it sets no limit."""
        return np.inf


def at_rest(effects: Sequence[Effect]) -> list[Effect]:
    """Give the laws under which an object comes to rest.

    Raises:
        PlopError: The hook raised or gave no effect.
    """
    given = [(effect, call(effect, "at_rest")) for effect in effects]
    for effect, resting in given:
        if not isinstance(resting, Effect) or resting.name != effect.name:
            raise misused(effect, "at_rest", f"an effect {effect.name}", repr(resting)[:80])
    return [resting for _, resting in given]
