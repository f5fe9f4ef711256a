"""Numbers as a page writes them."""

from __future__ import annotations

import math

_ABSENT = "–"


def number(value: float | None, digits: int = 2) -> str:
    """Write a number, a dash where there is none."""
    return _ABSENT if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def short(value: float | None) -> str:
    """Write a number with three significant digits and no exponent where that is readable."""
    if value is None or not math.isfinite(value):
        return _ABSENT
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    return f"{float(f'{value:.3g}'):,.10g}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def percent(share: float) -> str:
    """Write a share in whole per cent."""
    return f"{100 * share:.0f} %"


def unbroken(sentence: str) -> str:
    """Keep a number on one line with its unit and its name."""
    for broken in (" %", " mm", " = "):
        sentence = sentence.replace(broken, broken.replace(" ", "\N{NO-BREAK SPACE}"))
    return sentence
