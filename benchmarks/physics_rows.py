"""What one run of the missing-physics benchmarks tells: its amplitude, and the share of the explainable gap closed."""

from __future__ import annotations

from typing import Any

from plop.diagnosis.candidates import BASE_COLUMNS
from plop.diagnosis.error_size import ErrorSize

_NO_GAP = 1.1
"""Error over the reference's below which there is nothing to close."""


def amplitude_of(row: dict[str, Any]) -> tuple[float, list[bool]]:
    """Compare a named law's amplitude with the hidden one, or give what the results' file kept of that comparison."""
    if "parameters" not in row:
        return row["amplitude_off"], row["amplitude_held"]
    named = row["named"][0]
    return amplitude_error(row["hidden"][named], row["parameters"].get(named, {}))


def amplitude_error(truth: dict[str, float], found: dict[str, Any]) -> tuple[float, list[bool]]:
    """Compare the fitted amplitudes with the hidden ones; two components of one vector are one amplitude.

    Returns:
        Length of the difference over the length of the truth, and for each number whether its interval holds the truth.
    """
    fitted = {key: found[key] for key in truth if key in found and not found[key].get("chosen")}
    off = sum((entry["value"] - truth[key]) ** 2 for key, entry in fitted.items()) ** 0.5
    length = sum(truth[key] ** 2 for key in fitted) ** 0.5
    return off / length, [e["low"] is not None and e["low"] <= truth[k] <= e["high"] for k, e in fitted.items()]


def gap_closed(row: dict[str, Any], left: float | None) -> float | None:
    """Give the share of the explainable gap that is closed where `left` is left.

    Returns:
        None where `left` is not known, or the error so little above the reference's that a share means nothing.
    """
    if not row["floor"] or row["error"] <= _NO_GAP * row["floor"]:
        return None
    return ErrorSize(row["error"], row["error"], row["floor"]).closed(left)


def closed_by_wrong_law(row: dict[str, Any]) -> float | None:
    """Give the share of the gap that the best law which is not hidden closes in held-out episodes.

    Stiffness, which is fitted along with every law, is none of the wrong ones; a law that does harm closes nothing.

    Returns:
        None where the row does not tell its laws' gains by their names, or where there is no gap.
    """
    gains = row.get("gains")
    if not isinstance(gains, dict):
        return None
    wrong = [gain for name, gain in gains.items() if name not in row["hidden"] and name not in BASE_COLUMNS]
    return gap_closed(row, row["error"] * (1 - max([0.0, *wrong])))
