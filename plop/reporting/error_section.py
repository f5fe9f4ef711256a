"""Where and when it fails, and before and after: the models side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plop.comparison.result import CameraRow, ErrorRow
from plop.reporting.baselines import BASELINES, is_beaten
from plop.reporting.compared import ReportFacts
from plop.reporting.errors_over import closed_gap, error_over
from plop.statistics.bootstrap import Interval

_METRICS = ("cd_mm", "emd_mm", "hd_mm", "psnr_db", "ssim", "j_score")


@dataclass(frozen=True)
class Bar:
    """One error of one model or baseline."""

    label: str
    colour: str
    mm: float
    thin: bool = False
    """Stands in the background."""


@dataclass(frozen=True)
class Group:
    """The errors of one row of a table."""

    label: str
    bars: list[Bar]
    floor_mm: float | None


@dataclass(frozen=True)
class Chart:
    """Bars in groups.

    Bars of the background do not set the scale beyond twice what the others need: where nothing moves is often so far
    off that the models could not be distinguished. A bar that is cut off so ends in a fade; its value stands beside it.
    """

    title: str
    groups: list[Group]

    @property
    def most_mm(self) -> float:
        """Error at the end of the scale [mm]."""
        every = [bar for group in self.groups for bar in group.bars]
        floors = [group.floor_mm for group in self.groups if group.floor_mm is not None]
        own = max([*(bar.mm for bar in every if not bar.thin), *floors], default=1.0)
        return min(max([own, *(bar.mm for bar in every)]), 2 * own) or 1.0


def where_section(facts: ReportFacts) -> list[Chart]:
    """Draw the error by phase, distance, height and camera."""
    tables = [c.errors.tables for c in facts.compared]
    charts = [
        _chart(facts, "Error by phase [mm]", [t.phase for t in tables]),
        _chart(facts, "Error [mm] by distance to the tool [mm]", [t.distance for t in tables]),
        _chart(facts, "Error [mm] by height above the table [mm]", [t.height for t in tables]),
    ]
    if tables[0].camera:
        charts.append(_chart(facts, "Mean depth difference by camera [mm]", [t.camera for t in tables]))
    return charts


def _chart(facts: ReportFacts, title: str, tables: Sequence[Sequence[ErrorRow | CameraRow]]) -> Chart:
    """Draw one table of every model; the rows of the first one say what is drawn."""
    errors = [{row.label: row.error_mm() for row in table} for table in tables]
    groups = []
    for row in tables[0]:
        models = [(c.label, c.colour, own.get(row.label), False) for c, own in zip(facts.compared, errors, strict=True)]
        # a comparison made before cameras had baselines has none to show
        others = [(b.label, b.colour, row.error_mm(b.key), True) for b in BASELINES]
        bars = [Bar(label, colour, mm, thin) for label, colour, mm, thin in models + others if mm is not None]
        groups.append(Group(row.label, bars, row.error_mm("floor")))
    return Chart(title, groups)


@dataclass(frozen=True)
class EpisodeRow:
    """Errors of every model over some episodes [mm]."""

    label: str
    kind: str
    """Whether they were held out of every fit; "" where that is not known."""
    errors: list[float | None]
    baselines: list[float | None]
    floor: float | None
    closed: float | None
    """Share of the way from the first model's error to the floor."""
    total: bool
    """Pools several episodes."""

    @property
    def beaten(self) -> list[bool]:
        """Whether a baseline's error is smaller than a model's."""
        return [is_beaten(error, self.baselines) for error in self.errors]


@dataclass(frozen=True)
class ScoreRow:
    """Mean scores of one model or baseline."""

    label: str
    scores: list[Interval | None]


@dataclass(frozen=True)
class EpisodesSection:
    """Every episode with every model, and the scores of `plop eval`."""

    rows: list[EpisodeRow]
    scores: list[ScoreRow]
    scored: int
    """Episodes that were scored."""
    scored_fitted: int
    """Those of them that something was fitted to."""


def before_after_section(facts: ReportFacts) -> EpisodesSection:
    """List every episode with every model, held-out episodes first, and their totals."""
    names = facts.compared[0].episodes
    groups = {
        "held out": [n for n in names if n in facts.held_out],
        "fitted to": [n for n in names if n in facts.fitted],
        "": [n for n in names if n not in facts.held_out and n not in facts.fitted],
    }
    rows = []
    for kind, episodes in groups.items():
        rows += [_row(facts, [name], name, kind) for name in episodes]
        if len(episodes) > 1:
            rows.append(_row(facts, episodes, f"{len(episodes)} episodes", kind))
    scored = facts.scores[0][1].episodes if facts.scores else {}
    return EpisodesSection(rows, _scores(facts), len(scored), sum(name in facts.fitted for name in scored))


def _row(facts: ReportFacts, episodes: list[str], label: str, kind: str) -> EpisodeRow:
    found = [error_over(compared, episodes) for compared in facts.compared]
    first, last = found[0], found[-1]
    return EpisodeRow(
        label,
        kind,
        [f["rms"] if f else None for f in found],
        [first[b.key] if first else None for b in BASELINES],
        first["floor"] if first else None,
        closed_gap(first, last) if first and last else None,
        len(episodes) > 1,
    )


def _scores(facts: ReportFacts) -> list[ScoreRow]:
    """Give what `plop eval` says of the same models, and of the baselines once: cloud and image scores."""
    labels = {b.key: b.label for b in BASELINES}
    rows = []
    for label, scores in facts.scores:
        for method in scores.methods if label == facts.scores[0][0] else [scores.method]:
            name = label if method == scores.method else f"baseline: {labels.get(method, method)}"
            rows.append(ScoreRow(name, [scores.methods[method]["episode"].get(metric) for metric in _METRICS]))
    return rows
