"""Numbers that are none: never kept as an answer, never printed."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

UNKNOWN = "unknown"
"""What stands in a text for a number that is not finite."""

_NO_NUMBER = re.compile(r"(?<![\w./@-])[-+]?(?:nan|inf)(?!\w|[./@-]\w)")
"""What formatting writes for NaN and infinities; not a part of a name, a path or an address."""


def json_ready(value: Any) -> Any:
    """Give a value as any JSON reader takes it: NaN and infinities become null, numpy's types Python's.

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
    return json_ready(value.item()) if hasattr(value, "item") else value  # numpy's bool is no number


def readable(text: str) -> str:
    """Write "unknown" where a formatted number was none."""
    return _NO_NUMBER.sub(UNKNOWN, text)
