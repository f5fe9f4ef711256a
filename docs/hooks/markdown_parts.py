"""Pieces of Markdown: tables, escaped text, code spans."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def rows(head: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """Write a table; a bar in a cell is escaped."""
    text = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for line in lines:
        cells = [str(cell).replace("|", "\\|").replace("\n", " ") for cell in line]
        text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text)


def escaped(text: str) -> str:
    """Escape characters with a meaning in Markdown or HTML; code spans stay as they are."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else part.replace("<", "&lt;").replace("*", "\\*") for part in parts)


def code(value: object) -> str:
    """Write a code span; nothing for nothing."""
    text = str(value)
    return "" if text == "" else f"`{text}`"
