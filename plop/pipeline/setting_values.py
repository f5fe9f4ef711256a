"""Conversion of values of the command line and of TOML to the types of settings."""

from __future__ import annotations

import enum
import json
import types
import typing
from typing import Any


def convert(value: Any, kind: Any) -> Any:
    """Convert a value of the command line or of TOML to the type of a setting.

    Args:
        value: As written on the command line, or as read from TOML.
        kind: The type, without `Annotated`.

    Raises:
        ValueError: It is not valid for the type.
    """
    try:
        return _convert(value, kind)
    except (ValueError, TypeError, KeyError, OverflowError) as error:
        raise ValueError(value) from error


def _convert(value: Any, kind: Any) -> Any:
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _convert_union(value, parts)
    if origin is typing.Literal:
        return parts[[str(part) for part in parts].index(str(value))]
    if origin in (tuple, list):
        return _convert_sequence(value, origin, parts)
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        named = {str(word).lower(): member for member in kind for word in (member.value, member.name)}
        return named[str(value).lower()]
    if kind is bool:
        return _convert_bool(value)
    if kind in (int, float):
        return _convert_number(value, kind)
    if kind is str and isinstance(value, str):
        return value
    raise TypeError(kind)


def _convert_union(value: Any, parts: tuple[Any, ...]) -> Any:
    if type(None) in parts and (value is None or str(value).lower() in ("none", "")):
        return None
    for part in parts:
        if part is not type(None):
            try:
                return _convert(value, part)
            except (ValueError, TypeError, KeyError, OverflowError):
                continue
    raise ValueError(value)


def _convert_sequence(value: Any, origin: type, parts: tuple[Any, ...]) -> Any:
    items = _items(value) if isinstance(value, str) else list(value)
    if origin is tuple and not (len(parts) == 2 and parts[1] is Ellipsis):
        return tuple(_convert(item, part) for item, part in zip(items, parts, strict=True))
    return origin(_convert(item, parts[0]) for item in items)


def _items(text: str) -> list[Any]:
    """Parse a list as in TOML, ["a", "b"], or words separated by commas; [ab]* is such a word."""
    try:
        listed = json.loads(text) if text.lstrip().startswith("[") else None
    except json.JSONDecodeError:
        listed = None
    return listed if isinstance(listed, list) else [item.strip() for item in text.split(",") if item.strip()]


def _convert_bool(value: Any) -> bool:
    words = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
    return value if isinstance(value, bool) else words[str(value).lower()]


def _convert_number(value: Any, kind: type) -> int | float:
    if isinstance(value, bool):
        raise TypeError(value)
    if kind is float:
        return float(value)
    number = float(value)
    if number != int(number):
        raise ValueError(value)
    return int(number) if isinstance(value, float) or not str(value).lstrip("+-").isdigit() else int(value)
