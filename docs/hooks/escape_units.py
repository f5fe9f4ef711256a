"""An extension of mkdocstrings: "[N, 3] [m]" in a docstring is a shape and a unit, not a link."""

from __future__ import annotations

import re
from typing import Any

import griffe


class EscapeUnits(griffe.Extension):
    """Escape the bracket of a unit that follows the bracket of a shape."""

    def on_object(self, *, obj: Any, **_: Any) -> None:
        """Change the docstring of every loaded object."""
        if obj.docstring:
            obj.docstring.value = re.sub(r"\]([ ,]?)\s?\[", r"]\1 \\[", obj.docstring.value)
