"""The sentences of a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence

from plop.diagnosis.error_size import EXCESS_LEAST, EXCESS_P, EXCESS_RATIO, ErrorSize
from plop.diagnosis.finding import Finding
from plop.diagnosis.verdict import VerdictKind
from plop.parameters import estimate_text, is_log_change, short_number

NEARLY_P = 0.05
"""Chance up to which an error that does not stand out is told with what is asked for."""


def parameters_text(finding: Finding) -> str:
    """Write parameters with intervals and units."""
    return ", ".join(estimate_text(name, p) for name, p in finding.parameters.items())


def nothing_text(kind: VerdictKind, tried: Sequence[str] | None = None) -> str:
    """Say that no law is named; of those that were `tried` only where these are not the whole library."""
    whole, some = {
        VerdictKind.NOTHING_DETECTABLE: (
            "No effect of the library can be detected in these recordings",
            "None of the laws that were tried can be detected in these recordings",
        ),
        VerdictKind.NONE_OF_THESE: (
            "Something is missing that the library does not hold",
            "Something is missing that none of the laws that were tried explains",
        ),
    }[kind]
    return f"{whole}." if tried is None else f"{some}: {', '.join(tried)}."


def lone_text(lone: Finding, episode: str, *, missing: bool, held_out: bool) -> str:
    """Say which law one episode alone shows.

    Args:
        lone: The law.
        episode: The episode.
        missing: Something is missing for sure.
        held_out: The law helps where it is held out, too; else it was seen where it was fitted to all episodes.
    """
    start = "Something is missing" if missing else "No effect can be detected in more than one episode"
    if held_out:
        what = f"{lone.name} takes {100 * lone.gain:.0f} % of the held-out error away, but"
    else:
        what = (
            f"fitted to all episodes, {lone.name} takes {100 * lone.shown:.0f} % of the error away "
            f"({parameters_text(lone)}), but"
        )
    return f"{start}: {what} {episode} alone shows it, so that it is not named."


def effect_text(kind: VerdictKind, best: Finding, others: list[str], share: float | None) -> str:
    """Name one effect, with those that cannot be told from it; `share` of the explainable gap is what it closes."""
    gained = f"it explains {100 * best.gain:.0f} % of the held-out error"
    closed = "" if share is None else f" and closes {100 * min(share, 1):.0f} % of the explainable gap"
    start = {VerdictKind.EFFECT: "Missing: ", VerdictKind.PARTLY: "Partly ", VerdictKind.CONFOUNDED: ""}[kind]
    what = best.name + (f", or {' or '.join(others)}, which these motions cannot tell apart" if others else "")
    return f"{start}{what}; {parameters_text(best)}{_end_text(best)}; {gained}{closed}."


def both_text(best: Finding, more: Finding, partly: bool, share: float | None) -> str:
    """Name two effects, the second fitted to what the first leaves; both close a `share` of the explainable gap."""
    closed = "" if share is None else f"; both close {100 * min(share, 1):.0f} % of the explainable gap"
    start = "Partly" if partly else "Missing:"
    shares = (
        f"the first explains {100 * best.gain:.0f} % of the held-out error, the second {100 * more.gain:.0f} % "
        "of what it leaves"
    )
    first = parameters_text(best) + _end_text(best)
    return (
        f"{start} {best.name} and {more.name}; {first}; {parameters_text(more)}; {shares}{closed}. "
        f"Add {best.name}, then diagnose again."
    )


def partly_base_text(base: Finding, others: Sequence[str]) -> str:
    """Name a parameter of the base that leaves much of the gap, with those that cannot be told from it."""
    either = f" (or {' or '.join(others)}, which these motions cannot tell from it)" if others else ""
    return (
        f"A changed {base.name}{either} explains a part: {_base_text(base)}; much of the gap remains, and no "
        "law of the library explains it."
    )


def base_text(base: Finding, also: list[str] | None = None, size: ErrorSize | None = None) -> str:
    """Name a parameter of the base instead of a law, with those whose change would do as well.

    Args:
        base: The parameter.
        also: The others.
        size: How large the error is with it, if it is fitted along: where that is still beyond the reference's, nobody
            knows whether a law is missing.
    """
    alike = f" A change of {' or '.join(also)} would explain as much." if also else ""
    share = None if size is None else size.closed_by_base
    if size is None or size.floor is None or share is None or not rest_stands_out(size):
        return f"No law is missing; a parameter of the base differs: {_base_text(base)}.{alike}"
    return (
        f"A parameter of the base differs: {_base_text(base)}; it closes {100 * min(share, 1):.0f} % of the "
        f"explainable gap. What is left, {short_number(size.error / size.floor)} times the reference's squared "
        f"error, is how the base follows another {base.name}, or what no law of the library does."
        f"{alike}"
    )


def rest_stands_out(size: ErrorSize) -> bool:
    """Tell whether what a changed base parameter leaves is still beyond the reference's error."""
    return size.closed_by_base is not None and (size.stands_out or size.beyond_chance)


def unsure_text(finding: Finding) -> str:
    """Say which law explains most where something is missing, but too few episodes tell that it is this one."""
    contrast = finding.contrast
    assert contrast is not None
    return (
        f"Something is missing. {finding.name} takes {100 * finding.gain:.0f} % of the held-out error away "
        f"({parameters_text(finding)}), but too few episodes tell whether its amplitude is another than in the "
        f"reference recordings ({contrast.errors:.1f} standard errors, p = {short_number(contrast.p)}), so that it "
        "is not named. Record more episodes of these motions and diagnose again."
    )


def nearly_text(size: ErrorSize) -> str:
    """Say by how much an error is larger than the reference's that hardly could be so by chance, and is not called so.

    Returns:
        Two sentences with a space before them; nothing where the error is no larger, or may well be so by chance.
    """
    if size.floor is None or size.excess_p is None or size.excess is None or size.stands_out:
        return ""
    if size.excess_p > NEARLY_P or size.error <= EXCESS_RATIO * size.floor:
        return ""
    return (
        f" But the mean squared error is {short_number(size.error / size.floor)} times that of the reference "
        f"recordings; the chance of that is p = {short_number(size.excess_p)}, and p <= {EXCESS_P:g}, or "
        f"{EXCESS_LEAST:g} standard errors instead of {size.excess:.1f}, is asked for. Record more episodes of "
        "these motions and diagnose again."
    )


def _base_text(base: Finding) -> str:
    """Write a base parameter's change: that of a logarithm as a factor, too."""
    name, change = next(iter(base.parameters.items()))
    factor = ""
    if is_log_change(name):
        value, low, high = map(math.exp, (change.value, change.low, change.high))
        interval = f" ({short_number(low)} to {short_number(high)})" if change.bounded else ""
        factor = f" x {short_number(value)}{interval}"
    return f"{base.name}{factor}, {parameters_text(base)}"


def _end_text(finding: Finding) -> str:
    return ", the end of its range: there may be more of it" if finding.at_bound else ""
