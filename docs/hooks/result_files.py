"""Result files, their provenance, and the formatting of their numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).resolve().parents[1] / "results"
PROVENANCE = "provenance"
"""File with date, commit and machine of results that do not hold them themselves."""
Table = tuple[Callable[[], str], tuple[str, ...]]
"""The function that makes a table, and the files that it shows."""


def read(name: str) -> dict[str, Any]:
    """Return one file of results."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def provenance(name: str) -> dict[str, str]:
    """Return command, date, commit and machine of a result; its own file takes precedence over the common one."""
    facts, kept = read(name), read(PROVENANCE).get(name, {})
    found = {key: facts.get(key, kept.get(key, "")) for key in ("command", "date", "commit", "machine")}
    machine = found["machine"]
    if isinstance(machine, dict):
        found["machine"] = f"{machine.get('cores', '?')} cores of a shared {machine.get('processor', '?')} machine"
    return found


def rate(found: dict[str, Any] | None) -> str:
    """Write a rate with its interval."""
    if not found or found.get("rate") is None:
        return "not run"
    return f"{100 * found['rate']:.0f} % ({100 * found['low']:.0f} to {100 * found['high']:.0f} %, n = {found['n']})"


def percent(value: float | None) -> str:
    """Write a share in per cent; nothing where it is unknown."""
    return "" if value is None else f"{100 * value:.0f} %"


def law(values: dict[str, Any]) -> str:
    """Write laws with their parameters."""
    return (
        "; ".join(f"{law} {', '.join(f'{k} {v:.3g}' for k, v in each.items())}" for law, each in values.items()) or "-"
    )
