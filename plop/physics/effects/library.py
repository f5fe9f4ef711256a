"""Find effects by name: built-in ones, and a user's from a file."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Iterable
from difflib import get_close_matches
from functools import lru_cache
from importlib.machinery import SourceFileLoader
from pathlib import Path

import plop.physics.effects as package
from plop.errors import PlopError
from plop.physics.effects.declared import check_declared
from plop.physics.effects.effect import Effect
from plop.physics.user_code import line_of, user_error

EffectType = type[Effect]


@lru_cache(maxsize=1)
def _own() -> dict[str, EffectType]:
    found: dict[str, EffectType] = {}
    for entry in sorted(pkgutil.iter_modules(package.__path__), key=lambda m: m.name):
        module = importlib.import_module(f"{package.__name__}.{entry.name}")
        for effect in _effects_of(module):
            found[effect.name] = effect
    return found


def _effects_of(module: object) -> list[EffectType]:
    """List the effects that a module defines; a class whose name begins with an underscore is a base of some."""
    return [
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Effect)
        and value is not Effect
        and not value.__name__.startswith("_")
        and value.__module__ == getattr(module, "__name__", None)
    ]


def library(effect_files: Iterable[str | Path] = ()) -> dict[str, EffectType]:
    """Return all effects by name: the built-in ones, then those of the user's files.

    Args:
        effect_files: Python files with subclasses of `Effect`.

    Raises:
        PlopError: A file cannot be used, or names an effect that exists.
    """
    found = dict(_own())
    for path in map(Path, effect_files):
        for effect in load_effect_file(path):
            if effect.name in found:
                line = line_of(effect, "name", path)
                raise PlopError(
                    "Two effects have the same name.",
                    where=f"{path}, line {line}",
                    found=effect.name,
                    fix="Give yours another name.",
                )
            found[effect.name] = effect
    return found


def effect_type(name: str, effects: dict[str, EffectType] | None = None) -> EffectType:
    """Return one effect's class by its name.

    Raises:
        PlopError: There is none; suggests the nearest name.
    """
    known = library() if effects is None else effects
    if name not in known:
        near = get_close_matches(name, known, 1)
        raise PlopError(
            "There is no such effect.",
            expected=", ".join(known),
            found=name,
            fix=f"Did you mean {near[0]}?" if near else "Choose one of these.",
        )
    return known[name]


def load_effect_file(path: Path) -> list[EffectType]:
    """Import a user's file and return the effects that it defines.

    Raises:
        PlopError: No such file, an error in it or in the declaration of an effect (names the line), or no effect.
    """
    if not path.is_file():
        raise PlopError(
            "There is no such effect file.",
            where=path,
            expected="a Python file",
            found="no file",
            fix="Check the path of --effect-file; docs/how-to/write-an-effect.md has a template.",
        )
    spec = importlib.util.spec_from_file_location(f"plop_user_effect_{path.stem}", path)
    assert spec is not None and isinstance(spec.loader, SourceFileLoader)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        # not `exec_module`: its bytecode is stale where a file was saved twice in a second
        exec(spec.loader.source_to_code(path.read_bytes(), str(path)), module.__dict__)
    except (Exception, SystemExit) as error:
        raise user_error(path, error) from error
    effects = _effects_of(module)
    if not effects:
        raise PlopError(
            "The effect file defines no effect.",
            where=path,
            expected="a subclass of Effect",
            found="none",
            fix="See the template in docs/how-to/write-an-effect.md.",
        )
    for effect in effects:
        check_declared(effect, path)
    return effects
