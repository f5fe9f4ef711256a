"""Non-finite numbers: never stored as a result, never printed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

UNKNOWN = "unknown"
"""Text in place of a number that is not finite."""

_NO_NUMBER = re.compile(r"(?<![\w./@-])[-+]?(?:nan|inf)(?!\w|[./@-]\w)")
"""Formatted NaN and infinities; not a part of a name, a path or an address."""


def json_ready(value: Any) -> Any:
    """Convert a value to standard JSON types: NaN and infinities become null, numpy types become Python types.

    Args:
        value: Numbers, texts, and mappings and sequences of them.
    """
    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value) if math.isfinite(value) else None
    return json_ready(value.item()) if hasattr(value, "item") else value  # numpy's bool is not a number


def readable(text: str) -> str:
    """Replace formatted non-finite numbers by "unknown"."""
    return _NO_NUMBER.sub(UNKNOWN, text)
