"""A stage's result as a frozen dataclass and as a JSON file with a schema number.

The fields and their types define the JSON layout: nested dataclasses, enums, tuples, mappings and optional values. A
class with its own `to_json` and `from_json` is written and read by these.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

from plop.artifacts.atomic_file import write_json
from plop.errors import PlopError
from plop.finite import json_ready


class SchemaError(PlopError):
    """A result has a schema that this version of plop does not read."""


class ResultFile:
    """Base of the results that stages write for other stages; a subclass is a frozen dataclass.

    Class variables: the file's name in the artifact, the command that writes it, and the number of its layout.
    """

    FILE: ClassVar[str]
    COMMAND: ClassVar[str]
    SCHEMA: ClassVar[int]

    def to_json(self) -> dict[str, Any]:
        """Return the content of the file: JSON types, non-finite numbers as null."""
        return {"schema": self.SCHEMA, **fields_to_json(self)}

    @classmethod
    def from_json(cls, found: Any, where: str | Path = "") -> Self:
        """Read what `to_json` wrote.

        Args:
            found: Content of the file.
            where: The file, for messages.

        Raises:
            SchemaError: It has another schema.
            PlopError: Something is missing or has the wrong type.
        """
        where = where or cls.FILE
        if not isinstance(found, Mapping):
            raise _unreadable(where, "an object with named values", found, cls.COMMAND)
        if found.get("schema") != cls.SCHEMA:
            raise SchemaError(
                "A result was written by another version of plop.",
                where=where,
                expected=f"schema {cls.SCHEMA}",
                found=f"schema {found.get('schema')}",
                fix=f"Make it again: `plop {cls.COMMAND}`.",
            )
        try:
            return _dataclass_of(cls, found, "")  # type: ignore[no-any-return]
        except _Unlike as error:
            raise _unreadable(f"{where}: {error.place}", error.expected, error.found, cls.COMMAND) from None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read it from an artifact's folder, or from the file itself.

        Raises:
            SchemaError: It has another schema.
            PlopError: It is missing or damaged.
        """
        path = Path(path)
        path = path / cls.FILE if path.is_dir() else path
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise _unreadable(path, cls.FILE, error, cls.COMMAND) from error
        return cls.from_json(found, path)

    def write(self, folder: Path) -> None:
        """Write it into an artifact's folder."""
        write_json(folder / self.FILE, self.to_json(), sort_keys=False)


def fields_to_json(value: Any) -> dict[str, Any]:
    """Return a dataclass's fields as JSON types."""
    return {field.name: to_json(getattr(value, field.name)) for field in fields(value)}


def to_json(value: Any) -> Any:
    """Return a value as JSON types."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if is_dataclass(value):
        return fields_to_json(value)
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    return json_ready(value.value if isinstance(value, Enum) else value)


class _Unlike(Exception):
    """A value does not have the type of its field."""

    def __init__(self, place: str, expected: str, found: Any) -> None:
        super().__init__(place)
        self.place, self.expected, self.found = place, expected, found


def _unreadable(where: str | Path, expected: str, found: Any, command: str) -> PlopError:
    return PlopError(
        "A result cannot be read.",
        where=where,
        expected=expected,
        found=str(found)[:200],
        fix=f"Make it again: `plop {command}`.",
    )


@cache
def _types(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _dataclass_of(kind: Any, found: Any, place: str) -> Any:
    if not isinstance(found, Mapping):
        raise _Unlike(place, "an object with named values", found)
    values, types = {}, _types(kind)
    for field in fields(kind):
        inner = f"{place}.{field.name}" if place else field.name
        if field.name in found:
            values[field.name] = _value_of(types[field.name], found[field.name], inner)
        elif field.default is MISSING and field.default_factory is MISSING:
            raise _Unlike(inner, "a value", "none")
    return kind(**values)


def _value_of(kind: Any, found: Any, place: str) -> Any:
    """Read one value; `place` names it, e.g. "ranking.0.gain"."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return found
    if origin in (Union, UnionType):
        return None if found is None else _value_of(next(k for k in inner if k is not type(None)), found, place)
    if origin is tuple:
        if not isinstance(found, list):
            raise _Unlike(place, "a list", found)
        return tuple(_value_of(inner[0], item, f"{place}.{k}") for k, item in enumerate(found))
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(found, Mapping):
            raise _Unlike(place, "an object with named values", found)
        return {key: _value_of(inner[1], item, f"{place}.{key}") for key, item in found.items()}
    if hasattr(kind, "from_json"):
        return _tried(kind.from_json, found, place, "as `plop` writes it")
    if is_dataclass(kind):
        return _dataclass_of(kind, found, place)
    if issubclass(kind, Enum):
        return _tried(kind, found, place, " or ".join(map(str, kind)))
    if kind is float:
        return math.nan if found is None else _tried(float, found, place, "a number")
    if not isinstance(found, kind):
        raise _Unlike(place, {bool: "true or false", int: "a whole number", str: "a text"}[kind], found)
    return found


def _tried(read: Callable[[Any], Any], found: Any, place: str, expected: str) -> Any:
    try:
        return read(found)
    except (LookupError, TypeError, ValueError, AttributeError):
        raise _Unlike(place, expected, found) from None
