"""Settings of a stage: defaults of its dataclass, then plop.toml, then the command line."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import math
import textwrap
import typing
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from plop.errors import PlopError
from plop.pipeline.setting_values import convert

SETTINGS_FILE = "plop.toml"
"""In the workspace."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """One field of a configuration; fields of a nested dataclass are named `outer.inner`."""

    key: str
    kind: Any
    """Its type annotation, resolved."""
    default: Any
    help: str
    """The docstring under the field: meaning and unit."""
    names_program: bool = False
    """It names a program to run: a workspace that came from somebody else must not choose it."""


def settings_of(config: type) -> list[Setting]:
    """List the fields of a configuration dataclass with their types, defaults and docstrings."""
    kinds = typing.get_type_hints(config)
    texts = _field_docstrings(config)
    found = []
    for field in dataclasses.fields(config):
        default = _default_of(field)
        kind = kinds[field.name]
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            for inner in settings_of(kind):
                value = _dig(default, inner.key)
                found.append(dataclasses.replace(inner, key=f"{field.name}.{inner.key}", default=value))
        else:
            found.append(
                Setting(field.name, kind, default, texts.get(field.name, ""), bool(field.metadata.get("names_program")))
            )
    return found


def _dig(value: Any, key: str) -> Any:
    for part in key.split("."):
        value = getattr(value, part)
    return value


def _default_of(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    raise TypeError(f"the setting {field.name} has no default")


def _field_docstrings(config: type) -> dict[str, str]:
    found: dict[str, str] = {}
    for owner in reversed(config.__mro__):
        if not dataclasses.is_dataclass(owner):
            continue
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(owner))).body[0]
        except (OSError, SyntaxError):
            continue
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if (
                isinstance(field, ast.AnnAssign)
                and isinstance(field.target, ast.Name)
                and isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
            ):
                found[field.target.id] = " ".join(str(text.value.value).split())
    return found


def resolve(config: type, stage: str, *layers: tuple[str, Mapping[str, Any]]) -> Any:
    """Build a configuration from its defaults and layers of overrides, later layers winning.

    Args:
        config: The stage's configuration dataclass.
        stage: Name of the command, for messages.
        layers: (where it comes from, flat overrides by setting key).

    Raises:
        PlopError: An unknown key, or a value of the wrong type, that is not finite, or a negative seed.
    """
    known = {setting.key: setting for setting in settings_of(config)}
    values: dict[str, Any] = {}
    for source, layer in layers:
        for key, value in layer.items():
            if key not in known:
                raise unknown_key(key, known, where=source, owner=stage)
            if known[key].names_program and source == SETTINGS_FILE:
                raise PlopError(
                    "A settings file names a program to run.",
                    where=f"{source}: {stage}.{key}",
                    expected="programs named on the command line only: a workspace may be a stranger's",
                    found=str(value),
                    fix=f"Remove the line, and give --{key} yourself.",
                )
            values[key] = checked(value, known[key].kind, key=f"{stage}.{key}", where=source)
    try:
        return _build(config, values)
    except (ValueError, TypeError) as error:
        raise PlopError(f"The settings of {stage} do not fit together.", found=str(error)) from error


def checked(value: Any, kind: Any, *, key: str, where: str) -> Any:
    """Turn a value into the type of a setting, and refuse what no setting takes.

    Args:
        value: As it was typed, or as TOML has it.
        kind: The type.
        key: The setting, `stage.key`.
        where: Where the value comes from.

    Raises:
        PlopError: It does not fit the type, is a number that is not finite, or a negative seed.
    """
    found = convert(value, kind, key=key, where=where)
    if not all(math.isfinite(number) for number in _numbers(found)):
        raise PlopError(
            "A setting is not finite.",
            where=f"{where}: {key}",
            expected="a finite number",
            found=str(value),
            fix="Give a number, or leave it out for the default.",
        )
    if key.rpartition(".")[2] == "seed" and found < 0:
        raise PlopError(
            "A seed is negative.",
            where=f"{where}: {key}",
            expected="0 or more",
            found=str(value),
            fix="Choose any other whole number.",
        )
    return found


def _numbers(value: Any) -> list[float]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, (tuple, list)):
        return [number for part in value for number in _numbers(part)]
    return [value] if isinstance(value, float) else []


def _build(config: type, values: Mapping[str, Any]) -> Any:
    kinds = typing.get_type_hints(config)
    own: dict[str, Any] = {key: value for key, value in values.items() if "." not in key}
    for field in dataclasses.fields(config):
        inner = {key.partition(".")[2]: v for key, v in values.items() if key.startswith(field.name + ".")}
        if inner:
            nested = {s.key: _dig(_default_of(field), s.key) for s in settings_of(kinds[field.name])}
            own[field.name] = _build(kinds[field.name], nested | inner)
    return config(**own)


def unknown_key(
    key: str, known: Mapping[str, Any] | list[str], *, where: str, owner: str, lister: str | None = None
) -> PlopError:
    """Describe an unknown key, with the nearest known ones; `lister`: the command that lists them, if not the owner."""
    close = get_close_matches(key, list(known), n=3, cutoff=0.5)
    return PlopError(
        f"{owner} has no setting {key!r}.",
        where=where,
        expected=", ".join(known),
        fix=f"Did you mean {' or '.join(close)}?" if close else f"`plop {lister or f'{owner} --help'}` lists them.",
    )
