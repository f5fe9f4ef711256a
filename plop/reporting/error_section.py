"""Where and when it fails, and before and after: the models side by side."""

from __future__ import annotations

from collections.abc import Sequence

from plop.comparison.result import CameraRow, ErrorRow
from plop.reporting.baselines import BASELINES, ORACLE, is_beaten
from plop.reporting.compared import ReportFacts
from plop.reporting.errors_over import closed_gap, error_over
from plop.reporting.html import Series, bars, number, table, text
from plop.reporting.verdict_section import gap_text
from plop.statistics.bootstrap import Interval

BEATEN = '<sup title="a baseline is better">▾</sup>'
BEATEN_NOTE = "<p class='soft'>▾ a baseline is better than the model here.</p>"
_BASELINE_LABELS = {b.key: f"baseline: {b.label}" for b in BASELINES}


def legend(facts: ReportFacts) -> str:
    """Name the colours of the models and of the baselines."""
    models = "".join(
        f'<span><i class="swatch" style="background:{c.colour}"></i>{text(c.label)}</span>' for c in facts.compared
    )
    others = "".join(f'<span><i style="height:6px;background:{b.colour}"></i>{text(b.label)}</span>' for b in BASELINES)
    return f'<p class="key">{models}{others}<span><i class="floor"></i>noise floor</span></p>'


def where_section(facts: ReportFacts) -> str:
    """Draw the error by phase, distance, height and camera."""
    tables = [c.errors.tables for c in facts.compared]
    charts = [
        _chart(facts, "By phase: error", [t.phase for t in tables]),
        _chart(facts, "By distance to the tool in mm: error", [t.distance for t in tables]),
        _chart(facts, "By height above the table in mm: error", [t.height for t in tables]),
    ]
    if tables[0].camera:
        charts.append(_chart(facts, "By camera: mean difference in depth", [t.camera for t in tables]))
    return (
        f"<h2>Where and when it fails</h2>{legend(facts)}<div class='charts'>{''.join(charts)}</div>"
        "<p class='soft'>RMS distance between measured and predicted points; the first frame is given and counts "
        "nowhere. The dotted tick is the floor: what noise alone would give (for cameras: what is left when the "
        f"measured points are rendered). {text(ORACLE)}</p>"
    )


def _chart(facts: ReportFacts, title: str, tables: Sequence[Sequence[ErrorRow | CameraRow]]) -> str:
    """Draw one table of every model; the rows of the first one say what is drawn."""
    rows = tables[0]
    labels = [row.label for row in rows]
    models = []
    for compared, own in zip(facts.compared, tables, strict=True):
        errors = {row.label: row.error_mm() for row in own}
        models.append(Series(compared.label, compared.colour, [errors.get(label) for label in labels]))
    # a comparison made before cameras had baselines has none to show
    others = [Series(b.label, b.colour, [row.error_mm(b.key) for row in rows], thin=True) for b in BASELINES]
    return bars(title, labels, [*models, *others], [row.error_mm("floor") for row in rows], "mm")


def before_after_section(facts: ReportFacts) -> str:
    """List every episode with every model, held-out episodes first, and their totals."""
    names = facts.compared[0].episodes
    groups = [
        ("held out", [n for n in names if n in facts.held_out]),
        ("fitted to", [n for n in names if n in facts.fitted]),
        ("", [n for n in names if n not in facts.held_out and n not in facts.fitted]),
    ]
    rows, marked = [], []
    for kind, episodes in groups:
        rows += [_row(facts, [name], name, kind) for name in episodes]
        if len(episodes) > 1:
            marked.append(len(rows))
            rows.append(_row(facts, episodes, f"{len(episodes)} episodes", kind))
    head = ["episode", "", *(c.label for c in facts.compared), *(b.label for b in BASELINES), "floor"]
    if len(facts.compared) > 1:
        head.append("way to the floor")
    body = table(head, rows, numeric=range(2, len(head)), marked=marked)
    note = BEATEN_NOTE if BEATEN in body else ""
    return f"<h2>{_title(facts)}</h2>{_note(facts)}{body}{note}{_scores(facts)}"


def _title(facts: ReportFacts) -> str:
    return "Before and after" if len(facts.compared) > 1 else "Episode by episode"


def _note(facts: ReportFacts) -> str:
    if len(facts.compared) < 2:
        return "<p class='soft'>RMS error in mm.</p>"
    if facts.held_out:
        what = "Neither a model nor an effect was fitted to the episodes that are held out."
    elif facts.fitted:
        what = (
            "No episode is held out here. The gain in the ranking is scored on held-out episodes: each is "
            "predicted with what the others say."
        )
    else:
        what = "Which episodes the effect was fitted to is not known here."
    return (
        "<p class='soft'>RMS error in mm. Way to the floor: share of the first model's error above the floor that "
        f"the last one takes away. {what}</p>"
    )


def _row(facts: ReportFacts, episodes: list[str], label: str, kind: str) -> list[str]:
    found = [error_over(compared, episodes) for compared in facts.compared]
    first, last = found[0], found[-1]
    baselines = [first[b.key] if first else None for b in BASELINES]
    cells = [text(label), text(kind), *(_error(None if f is None else f["rms"], baselines) for f in found)]
    cells += [*map(number, baselines), number(first["floor"] if first else None)]
    if len(facts.compared) > 1:
        cells.append(gap_text(closed_gap(first, last) if first and last else None))
    return cells


def _error(value: float | None, baselines: list[float | None]) -> str:
    """Write a model's error, with a mark where a baseline's is smaller."""
    return number(value) + (BEATEN if is_beaten(value, baselines) else "")


def _scores(facts: ReportFacts) -> str:
    """Show what `plop eval` says of the same models: cloud and image scores."""
    rows = []
    metrics = ("cd_mm", "emd_mm", "hd_mm", "psnr_db", "ssim", "j_score")
    for label, scores in facts.scores:
        for method in scores.methods if label == facts.scores[0][0] else [scores.method]:
            name = label if method == scores.method else _BASELINE_LABELS.get(method, f"baseline: {method}")
            found = [scores.methods[method]["episode"].get(metric) for metric in metrics]
            rows.append([text(name), *("–" if f is None else _mean(f) for f in found)])
    if not rows:
        return ""
    head = ["", "CD [mm]", "EMD [mm]", "HD [mm]", "PSNR [dB]", "SSIM", "J"]
    scored = facts.scores[0][1].episodes
    seen = sum(name in facts.fitted for name in scored)
    count = f"{len(scored)} episode{'s' if len(scored) > 1 else ''}"
    where = f"mean over {count}" + (f", fitted to: {seen}" if seen else "")
    return f"<h3>Scores of <code>plop eval</code> ({where}; 95 % interval)</h3>" + table(
        head, rows, numeric=range(1, 7)
    )


def _mean(found: Interval) -> str:
    known = found.low is not None and found.high is not None
    span = f" <span class='soft'>({found.low:.2f} to {found.high:.2f})</span>" if known else ""
    return f"{found.mean:.2f}{span}"
