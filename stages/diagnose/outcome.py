"""What a diagnosis says, as JSON types and as rows for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from plop.diagnosis.conclusion import Diagnosis
from plop.diagnosis.finding import Finding, explained_text
from plop.diagnosis.next_motion import next_motion, settling_motion
from plop.diagnosis.next_step import next_step
from plop.finite import json_ready
from plop.parameters import short_number, with_unit
from plop.physics.effects.library import EffectType
from plop.statistics.determined import NOT_DETERMINED, Allowed, determined

SCHEMA = 1


def facts_of(
    found: Diagnosis, types: Mapping[str, EffectType], sensors: list[dict[str, Any]], left_out: dict[str, str]
) -> dict[str, Any]:
    """Collect everything that was found; see docs/reference/outputs.md for the keys."""
    sizes = {score.candidate.effect: score.size_m for score in found.scores}
    ranking = [_row(finding, types, sizes.get(finding.name)) for finding in found.findings]
    alternatives = found.verdict.evidence.get("alternatives", [])
    confounded = found.verdict.named if alternatives else []
    left = found.verdict.evidence.get("left")
    return {
        "schema": SCHEMA,
        "verdict": {
            "kind": found.verdict.kind,
            "named": found.verdict.named,
            "text": found.verdict.text,
            "evidence": json_ready(found.verdict.evidence),
        },
        "ranking": [row for row, f in zip(ranking, found.findings, strict=True) if f is not found.findings[-1]],
        "base": ranking[-1],
        "confounded": confounded,
        "limits": json_ready(found.limits),
        "sensors": sensors,
        "shams": {"count": len(found.shams), "quantile_98": float(np.quantile(found.shams, 0.98))},
        "error": found.size.error,
        "floor": found.size.floor,
        "excess": found.size.excess,
        "closed_share": found.size.closed(left),
        "next_step": next_step(found),
        "next_motion": next_motion(found) or settling_motion(found),
        "episodes": [e.name for e in found.evidence],
        "reference_episodes": [e.name for e in found.control],
        "dropped": {**left_out, **found.dropped},
    }


def _row(finding: Finding, types: Mapping[str, EffectType], size_m: float | None) -> dict[str, Any]:
    kind = types.get(finding.name)
    return {
        "effect": finding.name,
        "kind": finding.kind,
        "help": kind.help if kind else "",
        "law": kind.law if kind else "",
        "source": kind.source if kind else "",
        "gain": finding.gain,
        "gain_error": finding.gain_error,
        "p": finding.p,
        "contrast": json_ready(finding.contrast and finding.contrast.errors),
        "contrast_p": json_ready(finding.contrast and finding.contrast.p),
        "size_mm": None if size_m is None else 1000 * size_m,
        "shown": finding.shown,
        "shown_by": finding.shown_by,
        "alone": json_ready(finding.alone),
        "parameters": json_ready(_parameters(finding, kind)),
        "passes": finding.passes(),
        "reasons": finding.reasons(),
    }


def _parameters(finding: Finding, kind: EffectType | None) -> dict[str, dict[str, Any]]:
    """Add to each parameter whether the recordings tell it at all."""
    declared = {p.name: p for p in kind.parameters()} if kind else {}

    def allowed(name: str) -> Allowed | None:
        p = declared.get(name)
        if kind is None or p is None:
            return None
        return Allowed(p.low, p.high, abs(p.step), tried=len({v.get(name, p.default) for v in kind.variants}))

    return {name: {**p, "determined": determined(name, p, allowed(name))} for name, p in finding.parameters.items()}


def rows_of(facts: Mapping[str, Any], most: int = 6) -> list[dict[str, Any]]:
    """Give the head of the ranking as rows for the terminal."""
    rows = []
    for row in [*facts["ranking"][:most], facts["base"]]:
        first: tuple[str, dict[str, Any]] | None = next(iter(row["parameters"].items()), None)
        rows.append(
            {
                "effect": row["effect"],
                "explains": explained_text(row["gain"], row["gain_error"]),
                "p": row["p"],
                "moves_mm": None if row["size_mm"] is None else round(row["size_mm"], 3),
                "parameter": first and _parameter_text(*first),
                "verdict": "named" if row["effect"] in facts["verdict"]["named"] else (row["reasons"] or ["passes"])[0],
            }
        )
    return rows


def _parameter_text(name: str, p: Mapping[str, Any]) -> str:
    found = with_unit(f"{name} = {short_number(p['value'])}", p["unit"])
    return found if p.get("determined", True) else f"{found}, {NOT_DETERMINED}"
