"""Annotations of settings, and the check of values against them.

    horizon: Annotated[int, Range(1), Unit("frames"), COMMON] = 4

A class of settings is a frozen dataclass derived from `Settings`: every object satisfies its annotations, whether it
comes from plop.toml, from the command line or from Python. Constraints between several settings are in the
`__post_init__` of the class.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import numbers
import types
import typing
from functools import cache
from typing import Annotated, Any, Literal

from plop.errors import PlopError


@dataclasses.dataclass(frozen=True)
class Range:
    """Smallest and largest value; for a tuple, those of each number in it."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    """Exclude `low` itself."""
    but: float | None = None
    """An excluded value inside the range."""

    def __contains__(self, value: float) -> bool:
        return (self.low < value if self.above else self.low <= value) and value <= self.high and value != self.but

    def text(self, unit: str = "") -> str:
        """Format the range with a unit; empty where every number is allowed."""
        low, high = (
            f"{end:g}".replace("e+", "e").replace("e0", "e").replace("e-0", "e-") for end in (self.low, self.high)
        )
        if self.high < math.inf:
            text = f"{'more than ' if self.above else ''}{low} to {high}"
        elif self.low > -math.inf:
            text = f"more than {low}" if self.above else f"{low} or more"
        else:
            text = "" if self.but is None else "any number"
        text = f"{text} {unit}".strip() if text else ""
        return text if self.but is None else f"{text}, not {self.but:g}"


@dataclasses.dataclass(frozen=True)
class Unit:
    """Unit of a number, e.g. "m"."""

    name: str


@dataclasses.dataclass(frozen=True)
class Formerly:
    """Former name of the setting; an error for it suggests the new name."""

    name: str


class Mark(enum.Enum):
    """Further properties of a setting."""

    COMMON = "common setting: `--help` shows it first"
    SAME_RESULT = "changes how a result is computed and not the result: not part of the fingerprint"
    PROGRAM = "names a program to run: a workspace from another author must not choose it"


COMMON, SAME_RESULT, PROGRAM = Mark.COMMON, Mark.SAME_RESULT, Mark.PROGRAM

Seed = Annotated[int, Range(0)]
Jobs = Annotated[int, Range(but=0), SAME_RESULT]
Split = Literal["train", "test", "all"]
Weight = Annotated[float, Range(0)]
Share = Annotated[float, Range(0, 1)]

ALL_CORES = -1
"""`jobs`: one process per core."""
AUTO_DEVICE = "auto"
"""`device`: cuda where there is one."""


@dataclasses.dataclass(frozen=True)
class Kind:
    """A parsed annotation."""

    type: Any
    """Type without the annotation."""
    range: Range = Range()
    unit: str = ""
    marks: frozenset[Mark] = frozenset()
    formerly: tuple[str, ...] = ()

    @property
    def choices(self) -> tuple[str, ...]:
        """The choices of a setting; empty where it has none."""
        if typing.get_origin(self.type) is Literal:
            return tuple(str(choice) for choice in typing.get_args(self.type))
        if isinstance(self.type, type) and issubclass(self.type, enum.Enum):
            return tuple(m.value if isinstance(m.value, str) else m.name.lower() for m in self.type)
        return ()

    @property
    def expected(self) -> str:
        """Choices, or range and unit, as text; empty where every value is allowed."""
        return " or ".join(self.choices) or self.range.text(self.unit)


def kind_of(annotation: Any) -> Kind:
    """Parse an annotation, `Annotated` or plain."""
    if typing.get_origin(annotation) is not Annotated:
        return Kind(annotation)
    bare, *said = typing.get_args(annotation)
    return Kind(
        bare,
        next((one for one in reversed(said) if isinstance(one, Range)), Range()),
        next((one.name for one in reversed(said) if isinstance(one, Unit)), ""),
        frozenset(one for one in said if isinstance(one, Mark)),
        tuple(one.name for one in said if isinstance(one, Formerly)),
    )


def kinds_of(settings: type) -> dict[str, Kind]:
    """Parse the annotations of all fields of a dataclass, by the field's name."""
    return _kinds_of(settings)


@cache
def _kinds_of(settings: type) -> dict[str, Kind]:
    hints = typing.get_type_hints(settings, include_extras=True)
    return {field.name: kind_of(hints[field.name]) for field in dataclasses.fields(settings)}


def is_nested(kind: Kind) -> bool:
    """Return whether a setting is a group of settings."""
    return isinstance(kind.type, type) and dataclasses.is_dataclass(kind.type)


def check_value(value: Any, kind: Kind, *, where: str, fix: str = "", given: Any = None) -> None:
    """Reject a value that the annotation excludes.

    Args:
        value: Value of the setting's type.
        kind: The annotation.
        where: Name of the setting, and source of the value.
        fix: What to do about it.
        given: The value as written by the user, for the message.

    Raises:
        PlopError: The value is of another type, not finite, out of range or not one of the choices.
    """
    fix = fix or "Use another value, or omit the option for the default."
    shown = str(value if given is None else given)
    literal = typing.get_origin(kind.type) is Literal
    if not _fits(value, kind.type) or (literal and value not in typing.get_args(kind.type)):
        name = describe(kind.type)
        raise PlopError("A setting has an invalid value.", where=where, expected=name, found=repr(value), fix=fix)
    for number in _numbers(value):
        if not math.isfinite(number):
            raise PlopError(
                "A setting is not finite.",
                where=where,
                expected=kind.expected or "a finite number",
                found=shown,
                fix=fix,
            )
        if number not in kind.range:
            raise PlopError("A setting is out of range.", where=where, expected=kind.expected, found=shown, fix=fix)


def _fits(value: Any, kind: Any) -> bool:
    """Return whether numbers have the right type, and tuples the right length."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is tuple and Ellipsis not in parts:
        return isinstance(value, tuple) and len(value) == len(parts) and all(map(_fits, value, parts))
    real = {int: numbers.Integral, float: numbers.Real}.get(kind)
    if real is not None:
        return isinstance(value, real) and not isinstance(value, bool)
    return value is None if kind is type(None) else True


def _numbers(value: Any) -> list[float]:
    if isinstance(value, (tuple, list)):
        return [number for part in value for number in _numbers(part)]
    return [float(value)] if isinstance(value, numbers.Real) and not isinstance(value, (bool, enum.Enum)) else []


def describe(kind: Any) -> str:
    """Return the name of a type for messages."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(describe(part) for part in parts)
    if origin in (tuple, list):
        if origin is list or (len(parts) == 2 and parts[1] is Ellipsis):
            return f"{describe(parts[0])}, ..."
        return ", ".join(describe(part) for part in parts)
    if choices := Kind(kind).choices:
        return " or ".join(choices)
    if kind is type(None):
        return "none"
    return {int: "integer", float: "number", str: "text", bool: "yes/no"}.get(kind, str(kind))


class Settings:
    """A frozen dataclass of settings, each with a default; every object satisfies its annotations."""

    def __post_init__(self) -> None:
        for name, kind in kinds_of(type(self)).items():
            if not is_nested(kind):
                check_value(getattr(self, name), kind, where=f"{type(self).__name__}.{name}")

    def _check_order(self, problem: str, low: str, high: str, table: str = "") -> None:
        """Reject a length [m] that is below another one; `table` is where plop.toml has both, with its dot."""
        least, most = getattr(self, low), getattr(self, high)
        if most < least:
            raise PlopError(
                problem,
                where=f"{table}{high}, {table}{low}",
                expected=f"{high} of {least:g} m or more",
                found=f"{most:g} m",
                fix=f"Raise {high}, or lower {low}.",
            )
