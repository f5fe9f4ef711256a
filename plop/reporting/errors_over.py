"""Errors pooled over some episodes, and which episodes the headline counts."""

from __future__ import annotations

import math

from plop.reporting.compared import Compared, ReportFacts


def error_over(compared: Compared, episodes: list[str]) -> dict[str, float] | None:
    """RMS error, floor and baselines over some episodes, each with the weight of its points [mm]; None without any."""
    rows = [row for row in compared.errors.tables.episode if row.label in episodes]
    if not rows:
        return None
    count = sum(row.n for row in rows)

    def pooled(of: str) -> float:
        return math.sqrt(sum(row.n * row.error_mm(of) ** 2 for row in rows) / count)

    return {of: pooled(of) for of in ("rms", "floor", "persistence", "rigid")}


def closed_gap(before: dict[str, float], after: dict[str, float]) -> float | None:
    """Share of the way from an error down to the noise floor that was gone; None where it was there already."""
    gap = before["rms"] - before["floor"]
    return (before["rms"] - after["rms"]) / gap if gap > 0 else None


def judged_on(facts: ReportFacts) -> tuple[list[str], str]:
    """Episodes that the headline counts, and what they are called."""
    if facts.held_out:
        return facts.held_out, "held-out episodes"
    return facts.compared[0].episodes, "all episodes, none held out" if facts.fitted else "all episodes"
