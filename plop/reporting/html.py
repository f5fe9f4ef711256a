"""Pieces of a page: text, tables and bars. Everything that comes from data is escaped here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
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


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    numeric: Sequence[int] = (),
    marked: Sequence[int] = (),
    greyed: Sequence[int] = (),
    cards: bool = False,
) -> str:
    """Make a table of ready HTML cells; it scrolls inside its own box where it is wider than the page.

    Args:
        head: Titles.
        rows: Cells.
        numeric: Columns that are set to the right.
        marked: Rows that stand out.
        greyed: Rows that are no results.
        cards: On a narrow screen each row becomes a card with its titles beside the cells: for rows of text, which
            are read one by one; figures, which are compared with each other, scroll.
    """

    def cell(tag: str, column: int, content: str) -> str:
        kind = ' class="num"' if column in numeric else ""
        title = f' data-head="{text(head[column])}"' if cards and tag == "td" else ""
        inner = f"<div>{content}</div>" if title and content else content  # a card sets title and cell side by side
        return f"<{tag}{kind}{title}>{inner}</{tag}>"

    def row_class(place: int) -> str:
        kinds = ["named"] * (place in marked) + ["open"] * (place in greyed)
        return f' class="{" ".join(kinds)}"' if kinds else ""

    top = "".join(cell("th", k, text(title)) for k, title in enumerate(head))
    body = "".join(
        f"<tr{row_class(place)}>{''.join(cell('td', k, c) for k, c in enumerate(row))}</tr>"
        for place, row in enumerate(rows)
    )
    kind = "wide cards" if cards else "wide"
    return (
        f'<div class="{kind}" tabindex="0" role="region" aria-label="table: {text(head[0])}"><table>'
        f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>"
    )


@dataclass(frozen=True)
class Series:
    """One thing that is drawn as a bar in every group."""

    label: str
    colour: str
    values: Sequence[float | None]
    """One for each group."""
    thin: bool = False
    """Stands in the background."""


def bars(title: str, labels: Sequence[str], series: Sequence[Series], floors: Sequence[float | None], unit: str) -> str:
    """Draw horizontal bars in groups, a tick at the floor of each group, as a table that any width and reader can read.

    Bars of the background do not set the scale beyond twice what the others need: where nothing moves is often so far
    off that the models could not be told apart. A bar that is cut off so ends in a fade; its value stands beside it.

    Args:
        title: Heading.
        labels: One for each group.
        series: What is drawn in each.
        floors: One for each group.
        unit: Unit of the values.
    """
    own = [v for s in series if not s.thin for v in s.values if v is not None] + [v for v in floors if v is not None]
    every = own + [v for s in series for v in s.values if v is not None]
    most = min(max(every, default=1.0), 2 * max(own, default=1.0)) or 1.0
    rows = []
    for group, label in enumerate(labels):
        shown = [s for s in series if s.values[group] is not None]
        floor = floors[group]
        tick = "" if floor is None else f'<b style="left:{_place(floor, most)}"></b>'
        for k, s in enumerate(shown):
            value = s.values[group]
            assert value is not None
            kind = " ".join(["thin"] * s.thin + ["cut"] * (value > most))
            first = f'<th rowspan="{len(shown)}" scope="rowgroup">{text(label)}</th>' if k == 0 else ""
            rows.append(
                f'<tr{" class=first" if k == 0 else ""}>{first}<td>{tick}<i class="{kind}" style="width:'
                f'{_place(value, most)};background-color:{s.colour}"></i><span class="vh">{text(s.label)}: </span>'
                f"<span>{number(value)}</span></td></tr>"
            )
    return f'<div><h3>{text(title)} [{text(unit)}]</h3><table class="bars">{"".join(rows)}</table></div>'


def _place(value: float, most: float) -> str:
    """Length of a bar as CSS; the rest of the line is for its value."""
    return f"calc((100% - 52px) * {min(value / most, 1):.4f})"


def interval(value: float, error: float, low: float, high: float, colour: str) -> str:
    """Draw a dot with its standard error on a scale from `low` to `high`, with a line at zero; hidden from readers."""
    width, height = 150, 16

    def at(v: float) -> float:
        return width * (min(max(v, low), high) - low) / ((high - low) or 1.0)

    return (
        f'<svg width="{width}" height="{height}" viewBox="0 0 {width} {height}" aria-hidden="true">'
        f'<line x1="{at(0):.1f}" x2="{at(0):.1f}" y1="0" y2="{height}" stroke="#9aa0a8"/>'
        f'<line x1="{at(value - error):.1f}" x2="{at(value + error):.1f}" y1="8" y2="8" stroke="{colour}" '
        f'stroke-width="2"/><circle cx="{at(value):.1f}" cy="8" r="4" fill="{colour}"/></svg>'
    )
