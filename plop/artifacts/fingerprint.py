"""The fingerprint: one short hash of everything that determines an artifact."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from plop.setting_kinds import SAME_RESULT, is_nested, kinds_of

FINGERPRINT_LENGTH = 16
"""Hexadecimal digits kept (64 bits)."""


def plain(value: Any) -> Any:
    """Turn a configuration into JSON types: dataclass -> dict, tuple -> list, enum -> its value.

    Raises:
        TypeError: A value has no canonical JSON form (a path, a function, an array).
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"a configuration holds {type(value).__name__}, which is not a JSON type")


def deciding(config: Any) -> dict[str, Any]:
    """Select the settings that can change the result: all but those annotated with SAME_RESULT, nested ones too."""
    kinds, found = kinds_of(type(config)), {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if SAME_RESULT not in kinds[field.name].marks:
            found[field.name] = deciding(value) if is_nested(kinds[field.name]) else plain(value)
    return found


def flat_values(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """List settings with those of nested tables as `outer.inner`."""
    rows: list[tuple[str, Any]] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            rows += flat_values(value, f"{prefix}{key}.")
        else:
            rows.append((prefix + key, value))
    return rows


def fingerprint(stage: str, version: int, config: Mapping[str, Any], contents: Mapping[str, str]) -> str:
    """Hash a stage, its version, its configuration and the content digests of its inputs.

    Args:
        stage: Name of the stage.
        version: The stage's version.
        config: Configuration in JSON types.
        contents: Per input, the digest of its content; an input that was not given is absent.

    Returns:
        FINGERPRINT_LENGTH hexadecimal digits.
    """
    facts = {"stage": stage, "version": version, "config": dict(config), "contents": dict(contents)}
    text = json.dumps(facts, sort_keys=True, separators=(",", ":"), allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()[:FINGERPRINT_LENGTH]
