"""Check the declarations of a user's effect before anything runs, and name the wrong line."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from difflib import get_close_matches
from numbers import Real
from pathlib import Path
from typing import Any, get_args

import numpy as np

from plop.errors import PlopError
from plop.parameters import Parameter
from plop.physics.effects.effect import Effect, Kind
from plop.physics.user_code import line_of

HOOKS = ("material", "config", "before", "stress", "after", "slowest_step_s", "at_rest")
TEXTS = ("name", "help", "law", "source")


def check_declared(effect: type[Effect], path: Path) -> None:
    """Check that a class declares everything that an effect needs.

    Args:
        effect: The class, imported from a user's file.
        path: That file.

    Raises:
        PlopError: Something is missing or wrong; names its line, or that of the class.
    """
    for name, expected, found in _mistakes(effect):
        raise PlopError(
            "The effect file has an error.",
            where=f"{path}, line {line_of(effect, name, path)}",
            expected=f"{effect.__name__}.{name}: {expected}",
            found=found,
            fix="Correct that line; docs/how-to/write-an-effect.md has a template.",
        )


Mistake = tuple[str, str, str]
"""Name in the class, the expected value, the value found."""


def _mistakes(effect: type[Effect]) -> Iterator[Mistake]:
    for name in TEXTS:
        text = getattr(effect, name, None)
        if not (isinstance(text, str) and text.strip()):
            yield name, "some text", _seen(text)
    if not effect.name.replace("-", "_").isidentifier():
        yield "name", "letters, digits, - and _, not beginning with a digit", _seen(effect.name)
    if effect.kind not in get_args(Kind):
        yield "kind", " or ".join(get_args(Kind)), _seen(effect.kind)
    yield from _mistaken_parameters(effect, "amplitudes", least=1)
    yield from _mistaken_parameters(effect, "shapes", least=0)
    yield from _mistaken_values(effect)
    yield from _mistaken_variants(effect)
    yield from _mistaken_memory(effect)
    yield from _mistaken_hooks(effect)


def _mistaken_parameters(effect: type[Effect], name: str, *, least: int) -> Iterator[Mistake]:
    given = getattr(effect, name, None)
    whole = isinstance(given, tuple) and all(isinstance(each, Parameter) for each in given)
    if not whole or len(given or ()) < least:
        alone = " (a trailing comma is missing)" if isinstance(given, Parameter) else ""
        yield name, "a tuple of Parameter, such as (Parameter(...),)", _seen(given) + alone


def _mistaken_values(effect: type[Effect]) -> Iterator[Mistake]:
    seen: set[str] = set()
    for group, one in [(g, p) for g in ("amplitudes", "shapes") for p in getattr(effect, g)]:
        for expected, found in _mistaken_number(one, amplitude=group == "amplitudes"):
            yield group, expected, found
        if one.name in seen:
            yield group, "each name once", f"{one.name} twice"
        seen.add(one.name)


def _mistaken_number(one: Parameter, *, amplitude: bool) -> Iterator[tuple[str, str]]:
    """Yield the requirement on one parameter, and what was found instead."""
    if not (isinstance(one.name, str) and one.name.isidentifier()):
        yield "a parameter's name of letters, digits and _, not beginning with a digit", _seen(one.name)
    if not (isinstance(one.unit, str) and one.unit.strip()):
        yield f'{one.name}: a unit, such as "Pa"; "-" for a pure number', _seen(one.unit)
    given = {name: getattr(one, name) for name in ("low", "high", "step", "default", "typical")}
    for name, value in given.items():
        if not (isinstance(value, Real) and not isinstance(value, bool) and np.isfinite(float(value))):
            yield f"{one.name}: a finite number as {name}", _seen(value)
    if not one.low < one.high:
        yield f"{one.name}: low < high", f"{one.low:g} and {one.high:g}"
    if amplitude and one.default != 0:
        yield f"{one.name}: default 0, which means absent", f"{one.default:g}"
    if amplitude and not one.low <= 0 <= one.high:
        yield f"{one.name}: a range that contains 0, which means absent", f"{one.low:g} to {one.high:g}"
    if not one.low <= one.default <= one.high:
        yield f"{one.name}: a default in its range, {one.low:g} to {one.high:g}", f"{one.default:g}"
    if amplitude and not (one.step != 0 and one.low <= one.step <= one.high):
        yield f"{one.name}: a small amplitude in its range as step, not 0", f"{one.step:g}"


def _mistaken_variants(effect: type[Effect]) -> Iterator[Mistake]:
    shapes = {shape.name: shape for shape in effect.shapes}
    if not (isinstance(effect.variants, tuple) and effect.variants):
        yield "variants", "a tuple of dicts, at least one", _seen(effect.variants)
        return
    for variant in effect.variants:
        if not isinstance(variant, dict):
            yield "variants", "a tuple of dicts", _seen(variant)
            continue
        for key, value in variant.items():
            if key not in shapes:
                yield "variants", "names of shapes: " + (", ".join(shapes) or "it has none"), _seen(key)
            elif not (isinstance(value, float | int) and shapes[key].low <= value <= shapes[key].high):
                yield "variants", f"{key} from {shapes[key].low:g} to {shapes[key].high:g}", _seen(value)


def _mistaken_memory(effect: type[Effect]) -> Iterator[Mistake]:
    expected = "name -> (shape after N, first value), such as {'age': ((), 0.0)}"
    if not isinstance(effect.remembers, dict):
        yield "remembers", expected, _seen(effect.remembers)
        return
    for name, kept in effect.remembers.items():
        match kept:
            case (tuple() as shape, float() | int()) if all(isinstance(length, int) for length in shape):
                continue
        yield "remembers", expected, f"{name!r}: {_seen(kept)}"


def _mistaken_hooks(effect: type[Effect]) -> Iterator[Mistake]:
    own = {name for base in effect.__mro__[: effect.__mro__.index(Effect)] for name in vars(base)}
    if not own & set(HOOKS):
        near = [name for name in sorted(own) if callable(getattr(effect, name)) and get_close_matches(name, HOOKS, 1)]
        yield (
            (near[0] if near else "before"),
            "at least one hook: " + ", ".join(HOOKS),
            f"{near[0]}, which is never called" if near else "none: it would have no effect",
        )
    for name in HOOKS:
        expected = list(inspect.signature(getattr(Effect, name)).parameters)
        hook = getattr(effect, name)
        if not callable(hook):
            yield name, "a function", _seen(hook)
            continue
        try:
            inspect.signature(hook).bind(*expected)
        except TypeError:
            yield name, f"({', '.join(expected)})", str(inspect.signature(hook))


def _seen(value: Any) -> str:
    return "nothing" if value is None else repr(value)[:80]
