"""What diagnosis says, and what it says where it names nothing; never without its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from plop.diagnosis.contrast import P_LARGEST
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import AT_BOUND, CARRIED, Finding
from plop.diagnosis.verdict_text import nearly_text, parameters_text, unsure_text

SHOWN_LEAST = 0.2
"""Least share of the error that a law takes away, fitted to the one episode that shows it, to be told of."""

_NOTHING = "No effect of the library can be detected in these recordings."
_NONE = "Something is missing that the library does not hold."


@dataclass(frozen=True)
class Verdict:
    """What diagnosis says."""

    kind: str
    """NOTHING DETECTABLE, SENSOR, EFFECT, BASE PARAMETER, CONFOUNDED, PARTLY or NONE OF THESE."""
    named: list[str]
    """Effects, base parameters or sensor faults it names; the most likely first."""
    text: str
    """One sentence."""
    evidence: dict[str, Any] = field(default_factory=dict)


def unnamed(kind: str, findings: list[Finding], facts: dict[str, Any], more: str = "") -> Verdict:
    """Name nothing, but say which law would have been named, if only in part, had more than one episode shown it.

    Args:
        kind: The verdict.
        findings: All laws.
        facts: Evidence.
        more: Is said behind it.
    """
    missing = kind == "NONE OF THESE"
    told = [f for f in findings if f.kind == "physics" and (_carried_only(f) or (missing and _shown_once(f)))]
    lone = max(told, key=lambda f: f.shown, default=None)
    if lone is None and missing and (unsure := [f for f in findings if f.kind == "physics" and f.hardly_differs()]):
        return Verdict(kind, [], unsure_text(max(unsure, key=lambda f: f.gain)), facts)
    if lone is None:
        return Verdict(kind, [], (_NONE if missing else _NOTHING) + more, facts)
    start = "Something is missing" if missing else "No effect can be detected in more than one episode"
    if _carried_only(lone):
        episode, what = lone.helps, f"{lone.name} takes {100 * lone.gain:.0f} % of the held-out error away, but"
    else:
        episode = lone.shown_by
        what = (
            f"fitted to all episodes, {lone.name} takes {100 * lone.shown:.0f} % of the error away "
            f"({parameters_text(lone)}), but"
        )
    text = f"{start}: {what} {episode} alone shows it, so that it is not named.{more}"
    return Verdict(kind, [], text, {**facts, "lone": {"effect": lone.name, "episode": episode}})


def _carried_only(finding: Finding) -> bool:
    """Tell whether nothing but the other episodes, or else the end of its range, is against a law."""
    return CARRIED in finding.reasons() and {*finding.reasons()} <= {CARRIED, AT_BOUND}


def _shown_once(finding: Finding) -> bool:
    """Tell whether one episode shows a law well that, held out, the others cannot predict: they do not hold it."""
    return finding.shown_by != "" and finding.shown >= SHOWN_LEAST and not finding.at_bound


def may_be_chance(size: ErrorSize) -> bool:
    """Tell whether the gap may be no more than what motions differ by.

    Most of such a gap is nothing that a law or a parameter could have explained.
    """
    return not size.stands_out and size.excess_p is not None and size.excess_p > P_LARGEST


def nothing(facts: dict[str, Any], size: ErrorSize) -> Verdict:
    """Say that no effect of the library can be detected, and what came near it."""
    return Verdict("NOTHING DETECTABLE", [], _NOTHING + nearly_text(size), facts)


def among(verdict: Verdict, tried: Sequence[str]) -> Verdict:
    """Let a verdict that names nothing speak of the laws that were tried only: the library was not tried whole."""
    texts = {
        _NOTHING: "None of the laws that were tried can be detected in these recordings",
        _NONE: "Something is missing that none of the laws that were tried explains",
    }
    start = next((start for start in texts if verdict.text.startswith(start)), None)
    if start is None:
        return verdict
    return replace(verdict, text=f"{texts[start]}: {', '.join(tried)}.{verdict.text.removeprefix(start)}")
