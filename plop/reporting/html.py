"""Pieces of a page: text, tables and bars. Everything that comes from data is escaped here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any


def text(value: Any) -> str:
    """Escape anything for a page."""
    return escape(str(value), quote=True)


def number(value: float | None, digits: int = 2) -> str:
    """Write a number, a dash where there is none."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    return f"{value:.{digits}f}"


def short(value: float | None) -> str:
    """Write a number with three significant digits and no exponent where that is readable."""
    if value is None or not math.isfinite(value):
        return "–"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    return f"{float(f'{value:.3g}'):,.10g}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, numeric: Sequence[int] = (),
          marked: Sequence[int] = ()) -> str:  # fmt: skip
    """Make a table of ready HTML cells.

    Args:
        head: Titles.
        rows: Cells.
        numeric: Columns that are set to the right.
        marked: Rows that stand out.
    """

    def cell(tag: str, column: int, content: str) -> str:
        kind = ' class="num"' if column in numeric else ""
        return f"<{tag}{kind}>{content}</{tag}>"

    top = "".join(cell("th", k, text(title)) for k, title in enumerate(head))
    body = "".join(
        f"<tr{' class=named' if place in marked else ''}>{''.join(cell('td', k, c) for k, c in enumerate(row))}</tr>"
        for place, row in enumerate(rows)
    )
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def bars(
    title: str, labels: Sequence[str], series: Sequence[Sequence[float | None]], colours: Sequence[str],
    floors: Sequence[float | None], unit: str,
) -> str:  # fmt: skip
    """Draw horizontal bars in groups, a tick at the floor of each group.

    Args:
        title: Heading.
        labels: One for each group.
        series: For each series the value of every group.
        colours: One for each series.
        floors: One for each group.
        unit: Unit of the values.
    """
    thick, gap, left, width = 13 if len(series) > 1 else 17, 9, 118, 520
    most = max([v for row in [*series, floors] for v in row if v is not None] or [1.0]) or 1.0
    reach = width - left - 66
    parts, y = [], 4
    for group, label in enumerate(labels):
        height = thick * len(series)
        parts.append(f'<text x="{left - 8}" y="{y + height / 2 + 4:.1f}" text-anchor="end">{text(label)}</text>')
        for k, values in enumerate(series):
            value = values[group]
            if value is None:
                continue
            top, long = y + k * thick, reach * value / most
            parts.append(f'<rect x="{left}" y="{top + 1}" width="{long:.1f}" height="{thick - 2}" '
                         f'fill="{colours[k]}"/>')  # fmt: skip
            parts.append(f'<text x="{left + long + 5:.1f}" y="{top + thick / 2 + 4:.1f}">{number(value)}</text>')
        floor = floors[group]
        if floor is not None:
            at = left + reach * floor / most
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{y - 2}" y2="{y + height + 2}" stroke="#000" '
                         'stroke-width="1.5" stroke-dasharray="2 2"/>')  # fmt: skip
        y += height + gap
    return (f'<div><h3>{text(title)} [{text(unit)}]</h3><svg viewBox="0 0 {width} {y}" width="100%" role="img" '
            f'aria-label="{text(title)}">{"".join(parts)}</svg></div>')  # fmt: skip


def interval(value: float, error: float, low: float, high: float, colour: str) -> str:
    """Draw a dot with its standard error on a scale from `low` to `high`, with a line at zero."""
    width, height = 150, 16

    def at(v: float) -> float:
        return width * (min(max(v, low), high) - low) / ((high - low) or 1.0)

    return (f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" aria-hidden="true">'
            f'<line x1="{at(0):.1f}" x2="{at(0):.1f}" y1="0" y2="{height}" stroke="#9aa0a8"/>'
            f'<line x1="{at(value - error):.1f}" x2="{at(value + error):.1f}" y1="8" y2="8" stroke="{colour}" '
            f'stroke-width="2"/><circle cx="{at(value):.1f}" cy="8" r="4" fill="{colour}"/></svg>')  # fmt: skip
