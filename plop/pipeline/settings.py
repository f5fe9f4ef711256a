"""Settings of a stage: defaults of its dataclass, then plop.toml, then the command line.

No library: tyro (tried, 1.0) and jsonargparse would only replace the creation of options, since they accept nan, know
neither ranges with units nor the source of a value (plop.toml, `--set`, command line), and end the process with a
message of their own instead of a PlopError.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Mapping
from difflib import SequenceMatcher, get_close_matches
from typing import Any

from plop.errors import PlopError
from plop.pipeline.setting_values import convert
from plop.setting_kinds import COMMON, PROGRAM, Kind, check_value, describe, is_nested, kind_of, kinds_of

SETTINGS_FILE = "plop.toml"
"""Name of the settings file in the workspace."""
_LISTED = 16
"""Largest number of names listed in a message."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """Description of one setting: a row of `--help` and of the reference."""

    key: str
    """Its name; of nested settings `outer.inner`."""
    kind: Kind
    """Type, range, unit and choices."""
    default: Any
    help: str
    """The docstring under the field."""
    group: str = ""
    """Description of its group of nested settings: the docstring under the group's field; empty outside groups."""

    @property
    def common(self) -> bool:
        """Whether it is one of the common settings."""
        return COMMON in self.kind.marks


def settings_of(config: type) -> list[Setting]:
    """Describe the settings of a dataclass, nested ones at the position of their group."""
    texts, kinds = field_docstrings(config), kinds_of(config)
    found = []
    for field in dataclasses.fields(config):
        kind, default, text = kinds[field.name], _default_of(field), texts.get(field.name, "")
        if not is_nested(kind):
            found.append(Setting(field.name, kind, default, text))
            continue
        for inner in settings_of(kind.type):
            key, group = f"{field.name}.{inner.key}", inner.group or text
            found.append(dataclasses.replace(inner, key=key, default=_dig(default, inner.key), group=group))
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


def field_docstrings(config: type) -> dict[str, str]:
    """Give field -> the string below it, in one line; from the source of a dataclass and those that it extends."""
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
        layers: (source, flat overrides by setting key).

    Raises:
        PlopError: An unknown key, a value that its annotation excludes, or inconsistent settings.
    """
    known = {setting.key: setting for setting in settings_of(config)}
    values: dict[str, Any] = {}
    for source, layer in layers:
        for key, value in layer.items():
            if key not in known:
                raise unknown_setting(key, list(known.values()), where=source, stage=stage)
            kind, where = known[key].kind, f"{source}: {stage.replace(' ', '.')}.{key}"
            if PROGRAM in kind.marks and source == SETTINGS_FILE:
                raise PlopError(
                    "A settings file names a program to run.",
                    where=where,
                    expected="programs named on the command line only: the workspace may come from an untrusted source",
                    found=str(value),
                    fix=f"Remove the line, and use --{key} on the command line.",
                )
            values[key] = checked(value, kind, where=where, fix=f"`plop {stage} --help` describes it.")
    try:
        return _replaced(config(), values)
    except PlopError as error:
        error.where = f"{stage}: {error.where}" if error.where else stage
        raise


def checked(value: Any, annotation: Any, *, where: str, fix: str = "") -> Any:
    """Convert a value to the type of a setting, and reject what its annotation excludes.

    Args:
        value: As written on the command line, or as read from TOML.
        annotation: A `Kind`, or the annotation of a field.
        where: The setting and the source of its value.
        fix: What to do about an invalid value.

    Raises:
        PlopError: It is not valid.
    """
    kind = annotation if isinstance(annotation, Kind) else kind_of(annotation)
    try:
        found = convert(value, kind.type)
    except ValueError as error:
        expected = describe(kind.type) + (f", {kind.expected}" if kind.expected and not kind.choices else "")
        close = get_close_matches(str(value), kind.choices, n=1)
        raise PlopError(
            "A setting has an invalid value.",
            where=where,
            expected=expected,
            found=repr(value),
            fix=f"Did you mean {close[0]}?" if close else fix,
        ) from error
    check_value(found, kind, where=where, fix=fix, given=value)
    return found


def _replaced(settings: Any, values: Mapping[str, Any]) -> Any:
    """Return a copy of the settings with some of them changed, by key."""
    own: dict[str, Any] = {key: value for key, value in values.items() if "." not in key}
    for group in dict.fromkeys(key.partition(".")[0] for key in values if "." in key):
        inner = {key.partition(".")[2]: value for key, value in values.items() if key.startswith(group + ".")}
        own[group] = _replaced(getattr(settings, group), inner)
    return dataclasses.replace(settings, **own)


def unknown_setting(key: str, known: list[Setting], *, where: str, stage: str) -> PlopError:
    """Describe an unknown key, with suggestions: renamed, in a group, or misspelt."""
    close = meant(key, known)
    inside = [s.key for s in known if s.key.startswith(key + ".")]
    if inside and inside == close:
        return PlopError(
            f"{stage} has no setting {key!r}: it is a group of settings.",
            where=where,
            expected=", ".join(inside),
            found=key,
            fix=f"Write for example {inside[0]}.",
        )
    return unknown_key(key, [s.key for s in known], where=where, owner=stage, close=close)


def meant(key: str, known: list[Setting]) -> list[str]:
    """Return suggestions for an unknown key: its new name, all of its group, or at most three similar ones."""
    renamed = [s.key for s in known if key in s.kind.formerly]
    found = renamed or [s.key for s in known if s.key.startswith(key + ".")]
    if found:
        return found
    like = {s.key: _likeness(key, s.key) for s in known}
    best = max(like.values(), default=0.0)
    least = best if best == 1 else max(0.6, best - 0.1)
    return sorted((name for name in like if like[name] >= least), key=lambda name: -like[name])[:3]


def _likeness(one: str, other: str) -> float:
    """Return the similarity of two keys, 0 to 1: by letters, or by words in any order and any group."""
    words = [{word.rstrip("s") for word in re.split(r"[._-]", key)} for key in (one, other)]
    letters = max(SequenceMatcher(None, one, name).ratio() for name in (other, other.rpartition(".")[2]))
    return max(letters, 2 * len(words[0] & words[1]) / (len(words[0]) + len(words[1])))


def unknown_key(
    key: str, known: list[str], *, where: str, owner: str, lister: str | None = None, close: list[str] | None = None
) -> PlopError:
    """Describe an unknown key.

    Args:
        key: The key.
        known: The known keys.
        where: Source of the key.
        owner: The command that has the keys.
        lister: The command that lists them, if not the owner.
        close: Suggestions; None uses the most similar ones.
    """
    close = get_close_matches(key, known, n=3, cutoff=0.5) if close is None else close
    return PlopError(
        f"{owner} has no setting {key!r}.",
        where=where,
        expected=", ".join(known) if len(known) <= _LISTED else None,
        found=key,
        fix=f"Did you mean {' or '.join(close)}?" if close else f"`plop {lister or f'{owner} --help'}` lists them.",
    )
