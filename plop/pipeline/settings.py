"""Settings of a stage: defaults of its dataclass, then plop.toml, then the command line.

Kept by hand: tyro (tried, 1.0) and jsonargparse would replace the making of options and no more, since they take nan,
know neither ranges with units nor which of plop.toml, `--set` and the command line a value came from, and end the
process with a message of their own where a PlopError is due.
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
"""In the workspace."""
_LISTED = 16
"""More names than this are not listed in a message."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """One setting, described: a row of `--help` and of the reference."""

    key: str
    """Its name; of nested settings `outer.inner`."""
    kind: Kind
    """Type, range, unit and choices."""
    default: Any
    help: str
    """The docstring under the field."""
    group: str = ""
    """What the group of nested settings is for: the docstring under the field that holds it; empty outside groups."""

    @property
    def common(self) -> bool:
        """It is one of those that most people look for."""
        return COMMON in self.kind.marks


def settings_of(config: type) -> list[Setting]:
    """Describe the settings of a dataclass, nested ones where their group stands."""
    texts, kinds = _field_docstrings(config), kinds_of(config)
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
        PlopError: An unknown key, a value that its annotation rules out, or settings that do not fit together.
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
                    expected="programs named on the command line only: a workspace may be a stranger's",
                    found=str(value),
                    fix=f"Remove the line, and give --{key} yourself.",
                )
            values[key] = checked(value, kind, where=where, fix=f"`plop {stage} --help` describes it.")
    try:
        return _replaced(config(), values)
    except PlopError as error:
        error.where = f"{stage}: {error.where}" if error.where else stage
        raise


def checked(value: Any, annotation: Any, *, where: str, fix: str = "") -> Any:
    """Turn a value into the type of a setting, and refuse what its annotation rules out.

    Args:
        value: As it was typed, or as TOML has it.
        annotation: A `Kind`, or what stands behind the name of a field.
        where: The setting and where its value comes from.
        fix: What to do about a wrong one.

    Raises:
        PlopError: It does not fit.
    """
    kind = annotation if isinstance(annotation, Kind) else kind_of(annotation)
    try:
        found = convert(value, kind.type)
    except ValueError as error:
        expected = describe(kind.type) + (f", {kind.expected}" if kind.expected and not kind.choices else "")
        close = get_close_matches(str(value), kind.choices, n=1)
        raise PlopError(
            "A setting has a value of the wrong kind.",
            where=where,
            expected=expected,
            found=repr(value),
            fix=f"Did you mean {close[0]}?" if close else fix,
        ) from error
    check_value(found, kind, where=where, fix=fix, given=value)
    return found


def _replaced(settings: Any, values: Mapping[str, Any]) -> Any:
    """Give the same settings with some of them changed, by key."""
    own: dict[str, Any] = {key: value for key, value in values.items() if "." not in key}
    for group in dict.fromkeys(key.partition(".")[0] for key in values if "." in key):
        inner = {key.partition(".")[2]: value for key, value in values.items() if key.startswith(group + ".")}
        own[group] = _replaced(getattr(settings, group), inner)
    return dataclasses.replace(settings, **own)


def unknown_setting(key: str, known: list[Setting], *, where: str, stage: str) -> PlopError:
    """Describe an unknown key, with the settings that may be meant: renamed, in a group, or written otherwise."""
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
    """Give the keys that an unknown one may mean: its new name, all of its group, or at most three that are like it."""
    renamed = [s.key for s in known if key in s.kind.formerly]
    found = renamed or [s.key for s in known if s.key.startswith(key + ".")]
    if found:
        return found
    like = {s.key: _likeness(key, s.key) for s in known}
    best = max(like.values(), default=0.0)
    least = best if best == 1 else max(0.6, best - 0.1)
    return sorted((name for name in like if like[name] >= least), key=lambda name: -like[name])[:3]


def _likeness(one: str, other: str) -> float:
    """Give how alike two keys are, 0 to 1: letter by letter, or word by word in any order and any group."""
    words = [{word.rstrip("s") for word in re.split(r"[._-]", key)} for key in (one, other)]
    letters = max(SequenceMatcher(None, one, name).ratio() for name in (other, other.rpartition(".")[2]))
    return max(letters, 2 * len(words[0] & words[1]) / (len(words[0]) + len(words[1])))


def unknown_key(
    key: str, known: list[str], *, where: str, owner: str, lister: str | None = None, close: list[str] | None = None
) -> PlopError:
    """Describe an unknown key.

    Args:
        key: The key.
        known: Those that there are.
        where: Where it stands.
        owner: What has the keys.
        lister: The command that lists them, if not the owner.
        close: Those that may be meant; None takes the most alike.
    """
    close = get_close_matches(key, known, n=3, cutoff=0.5) if close is None else close
    return PlopError(
        f"{owner} has no setting {key!r}.",
        where=where,
        expected=", ".join(known) if len(known) <= _LISTED else None,
        found=key,
        fix=f"Did you mean {' or '.join(close)}?" if close else f"`plop {lister or f'{owner} --help'}` lists them.",
    )
