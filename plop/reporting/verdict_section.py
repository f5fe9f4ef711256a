"""The top of a report: the verdict in one sentence, and the figures that carry it."""

from __future__ import annotations

import math
from typing import Any

from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.html import number, text

_QUIET = ("NOTHING DETECTABLE", "NONE OF THESE")


def verdict_section(facts: ReportFacts) -> str:
    """Say what was found: the diagnosis of the first model, or, without one, where it fails most."""
    kind, sentence = _verdict(facts)
    quiet = " none" if kind in _QUIET or not facts.diagnoses else ""
    more = "".join(f"<p>{text(label)}, diagnosed again: <b>{text(d['verdict']['kind'])}</b>. "
                   f"{text(d['verdict']['text'])}</p>"
                   for label, d in facts.diagnoses[1:])  # fmt: skip
    figures = "".join(f"<div><b>{text(value)}</b>{text(name)}</div>" for name, value in _figures(facts))
    return (f'<section class="verdict{quiet}" id="verdict"><b class="kind">{text(kind)}</b>'
            f'<p class="says">{text(sentence).replace(" %", "&nbsp;%")}</p>{more}'
            f'<div class="facts">{figures}</div><p class="soft">{text(_held_out(facts))}</p></section>')  # fmt: skip


def _verdict(facts: ReportFacts) -> tuple[str, str]:
    if facts.diagnoses:
        label, diagnosis = facts.diagnoses[0]
        found, whose = diagnosis["verdict"], "" if label == facts.compared[0].label else f"Of {label}: "
        return str(found["kind"]), f"{whose}{found['text']}"
    first = facts.compared[0]
    return "NOT DIAGNOSED", f"{worst(first)} `plop diagnose` names what is missing."


def worst(compared: Compared) -> str:
    """Say where a model fails most."""
    tables = compared.facts["tables"]
    episode, phase = (max(tables[key], key=lambda row: row["rms_mm"]) for key in ("episode", "phase"))
    return (f"{compared.label} is off by {number(tables['all'][0]['rms_mm'])} mm (RMS), most in episode "
            f"{episode['episode']} ({number(episode['rms_mm'])} mm) and in the phase {phase['phase']} "
            f"({number(phase['rms_mm'])} mm).")  # fmt: skip


def error_over(compared: Compared, episodes: list[str]) -> dict[str, float] | None:
    """RMS error and floor over some episodes, each with the weight of its points [mm]; None without any."""
    rows = [row for row in compared.facts["tables"]["episode"] if row["episode"] in episodes]
    if not rows:
        return None
    count = sum(row["n"] for row in rows)

    def pooled(key: str) -> float:
        return math.sqrt(sum(row["n"] * row[key] ** 2 for row in rows) / count)

    return {key: pooled(f"{key}_mm") for key in ("rms", "floor", "persistence", "rigid")}


def closed_gap(before: dict[str, float], after: dict[str, float]) -> float | None:
    """Share of the way from an error down to the noise floor that was gone; None where it was there already."""
    gap = before["rms"] - before["floor"]
    return (before["rms"] - after["rms"]) / gap if gap > 0 else None


def judged_on(facts: ReportFacts) -> tuple[list[str], str]:
    """Episodes that the headline counts, and what they are called."""
    if facts.held_out:
        return facts.held_out, "held-out episodes"
    every = [row["episode"] for row in facts.compared[0].facts["tables"]["episode"]]
    return every, "all episodes, none held out" if facts.fitted else "all episodes"


def _held_out(facts: ReportFacts) -> str:
    """Say which episodes these figures are of, and whether anything was fitted to them."""
    every, _ = judged_on(ReportFacts("", facts.compared))
    fitted = [name for name in every if name in facts.fitted]
    if facts.held_out:
        others = f"; fitted to: {', '.join(fitted)}" if fitted else ""
        return f"Held out of every fit: {', '.join(facts.held_out)}{others}."
    if fitted:
        rest = [name for name in every if name not in fitted]
        free = f" Neither fitted to nor kept for the test: {', '.join(rest)}." if rest else ""
        which = ", ".join(fitted) if rest else "all of them"
        return (f"None of these episodes was held out: {which} took part in a fit, so that the error in new recordings "
                f"may be larger.{free}")  # fmt: skip
    return "Which of these episodes were held out of the fit is not known here."


def _figures(facts: ReportFacts) -> list[tuple[str, str]]:
    episodes, name = judged_on(facts)
    before, after = (error_over(c, episodes) for c in (facts.compared[0], facts.compared[-1]))
    figures: list[tuple[str, str]] = []
    if before is None or after is None:
        return figures
    if len(facts.compared) > 1:
        figures.append((f"error on {name}, {facts.compared[0].label} to {facts.compared[-1].label}",
                        f"{number(before['rms'])} → {number(after['rms'])} mm"))  # fmt: skip
        share = closed_gap(before, after)
        figures.append(("of the way from there to the noise floor", "–" if share is None else f"{100 * share:.0f} %"))
    else:
        figures.append((f"error on {name}, RMS", f"{number(before['rms'])} mm"))
        figures.append(("times the noise floor", number(before["rms"] / before["floor"], 1)))
    figures.append(("noise floor", f"{number(before['floor'])} mm"))
    return figures + _diagnosis_figures(facts)


def _diagnosis_figures(facts: ReportFacts) -> list[tuple[str, str]]:
    if not facts.diagnoses:
        return []
    found = facts.diagnoses[0][1]
    rows: list[dict[str, Any]] = found.get("ranking", [])
    base = [found["base"]] if found.get("base") else []
    named = next((row for row in [*rows, *base] if row["effect"] in found["verdict"]["named"]), None)
    if named is None:
        return []
    p = "" if named["p"] is None else f", p = {named['p']:.3f}"
    return [(f"of the held-out error explained{p}", f"{100 * named['gain']:.0f} ± {100 * named['gain_error']:.0f} %")]
