"""Verdicts that name nothing: why not, and what came nearest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from plop.diagnosis.contrast import P_LARGEST
from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.finding import Finding
from plop.diagnosis.verdict import Grounds, Lone, Reason, Verdict, VerdictKind
from plop.diagnosis.verdict_text import lone_text, nearly_text, nothing_text, unsure_text

SHOWN_LEAST = 0.2
"""Least share of the error that a law takes away, fitted to the one episode that shows it, to be told of."""


def unnamed(kind: VerdictKind, findings: list[Finding], facts: Grounds, size: ErrorSize) -> Verdict:
    """Name nothing, but say which law would have been named, if only in part, had more than one episode shown it.

    Args:
        kind: The verdict: NOTHING DETECTABLE or NONE OF THESE.
        findings: All laws.
        facts: Evidence.
        size: How large the error is.
    """
    missing = kind == VerdictKind.NONE_OF_THESE
    laws = [f for f in findings if f.kind == "physics"]
    lone = max((f for f in laws if _lone_only(f) or (missing and _shown_once(f))), key=lambda f: f.shown, default=None)
    if lone is not None:
        held_out = _lone_only(lone)
        told = Lone(lone.name, lone.helps if held_out else lone.shown_by)
        text = lone_text(lone, told.episode, missing=missing, held_out=held_out)
        return Verdict(kind, (), text + _more(kind, size), replace(facts, lone=told))
    unsure = max((f for f in laws if missing and f.hardly_differs()), key=lambda f: f.gain, default=None)
    if unsure is not None:
        return Verdict(kind, (), unsure_text(unsure), replace(facts, unsure=unsure.name))
    return Verdict(kind, (), nothing_text(kind) + _more(kind, size), facts)


def _lone_only(finding: Finding) -> bool:
    """Tell whether nothing but the other episodes, or else the end of its range, is against a law."""
    return Reason.ONE_EPISODE in finding.reasons() and {*finding.reasons()} <= {Reason.ONE_EPISODE, Reason.AT_BOUND}


def _shown_once(finding: Finding) -> bool:
    """Tell whether one episode shows a law well that, held out, the others cannot predict: they do not hold it."""
    return finding.shown_by != "" and finding.shown >= SHOWN_LEAST and not finding.at_bound


def may_be_chance(size: ErrorSize) -> bool:
    """Tell whether the gap may be no more than what motions differ by.

    Most of such a gap is nothing that a law or a parameter could have explained.
    """
    return not size.stands_out and size.excess_p is not None and size.excess_p > P_LARGEST


def nothing(facts: Grounds, size: ErrorSize) -> Verdict:
    """Say that no effect of the library can be detected, and what came near it."""
    kind = VerdictKind.NOTHING_DETECTABLE
    return Verdict(kind, (), nothing_text(kind) + _more(kind, size), facts)


def among(verdict: Verdict, tried: Sequence[str], size: ErrorSize) -> Verdict:
    """Let a verdict that names nothing speak of the laws that were tried only: the library was not tried whole."""
    of_all = verdict.kind in (VerdictKind.NOTHING_DETECTABLE, VerdictKind.NONE_OF_THESE)
    if not of_all or verdict.evidence.lone is not None or verdict.evidence.unsure is not None:
        return verdict
    return replace(verdict, text=nothing_text(verdict.kind, tried) + _more(verdict.kind, size))


def _more(kind: VerdictKind, size: ErrorSize) -> str:
    return nearly_text(size) if kind == VerdictKind.NOTHING_DETECTABLE else ""
