"""report: one HTML file that shows a colleague what was found, without plop and without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from plop.artifacts.atomic_file import write_text
from plop.artifacts.layouts import Report, ScoreFiles
from plop.artifacts.lineage import parents
from plop.artifacts.store import Artifact
from plop.diagnosis.decision.result import Diagnosis
from plop.errors import PlopError
from plop.metrics.scores import Scores
from plop.pipeline.stage import Choice, Input, Inputs, InputSpec, Output, Recipe, Stage, Summary
from plop.recordings.busiest_camera import check_camera
from plop.recordings.set import RecordingSet
from plop.reporting.baselines import BASELINES, beaten
from plop.reporting.compared import BandShown, ReportFacts
from plop.reporting.errors_over import closed_gap, error_over, judged_on
from plop.reporting.headline import headline
from plop.reporting.packed import packed_episode
from plop.reporting.page_file import report_page
from plop.reporting.report_images import episode_images, png_address
from plop.setting_kinds import Range, Settings, Unit
from plop.uncertainty.scores import BandScores
from stages import MODELS
from stages.common_inputs import init_input, recordings_input
from stages.report.made import provenance, this_report
from stages.report.sources import (
    check_models,
    fit_is_known,
    fitted_episodes,
    labels_of,
    model_key,
    read_compared,
    read_fields,
    several,
)

MOST_MB = 25.0
"""Largest page that still goes through mail."""


@dataclass(frozen=True)
class ReportConfig(Settings):
    """Settings of `report`; their defaults are written only here."""

    labels: tuple[str, ...] = ()
    """Names of the models, in the order of the comparisons; without them their addresses."""
    title: str = ""
    """Title of the page; without one it names the object."""
    frames: Annotated[int, Range(2), Unit("frames")] = 24
    """Most frames of an episode that are shown."""
    episodes: Annotated[int, Range(1), Unit("episodes")] = 12
    """Most episodes in the viewer, those with the largest error; tables contain all."""
    camera: str = ""
    """Camera of the images; when empty, the one whose image changes most."""
    difference_mm: Annotated[float, Range(1e-3), Unit("mm")] = 5.0
    """Depth difference at the ends of the colour scale."""


def run(inputs: Inputs, config: ReportConfig, out: Output) -> Summary:
    """Write report.html.

    Raises:
        PlopError: No comparison, results of different recordings or points, or labels that do not fit.
    """
    check_inputs(inputs, config)
    check_models(inputs)
    if not several(inputs, "comparisons"):
        raise PlopError(
            "A report needs a comparison.",
            where="report.comparisons",
            expected="artifacts of compare",
            found="none",
            fix="Run `plop compare`.",
        )
    recordings = RecordingSet.load(inputs["recordings"].path)
    labels = labels_of(inputs, config.labels)
    facts = _facts(inputs, config, recordings, labels)
    names = _common_episodes(facts)
    shown = _worst(facts, names, config.episodes)
    episodes: list[dict[str, Any]] = []
    for done, name in enumerate(shown):
        episodes.append(_episode(inputs, recordings, name, config))
        out.progress(done + 1, len(shown), name)
    page = report_page(facts, episodes, limit_mm=config.difference_mm)
    write_text(Report(out.path).page, page)
    return _summary(facts, len(page.encode()) / 1e6, names, shown)


def check_inputs(inputs: Inputs, config: ReportConfig) -> None:
    """Refuse a camera that the recordings do not have before models are compared and scored.

    Raises:
        PlopError: That camera, and those that there are.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    with recordings.open(recordings.names[0]) as first:
        check_camera(first, config.camera)


def _facts(inputs: Inputs, config: ReportConfig, recordings: RecordingSet, labels: list[str]) -> ReportFacts:
    keys = {model_key(item): label for item, label in zip(several(inputs, "comparisons"), labels, strict=True)}
    diagnoses = [
        (keys.get(model_key(item)) or labels[min(k, len(labels) - 1)], Diagnosis.load(item.path))
        for k, item in enumerate(several(inputs, "diagnoses"))
    ]
    diagnoses.sort(key=lambda pair: labels.index(pair[0]))
    evals = several(inputs, "evals")
    named = labels if len(evals) == len(labels) else [f"eval {k + 1}" for k in range(len(evals))]
    scores = [(name, Scores.load(item.path)) for name, item in zip(named, evals, strict=True)]
    fitted = fitted_episodes(inputs)
    held = [name for name in recordings.test if name not in fitted] if fit_is_known(inputs) else []
    manifest = inputs["recordings"].manifest
    return ReportFacts(
        config.title or f"{recordings.environment}: model and measurement",
        read_compared(inputs, labels, recordings),
        diagnoses,
        scores,
        _bands(evals, named),
        held,
        fitted,
        provenance(inputs),
        manifest.address if manifest else recordings.environment,
        this_report(inputs, asdict(config)),
    )


def _bands(evals: Sequence[Input], names: Sequence[str]) -> list[BandShown]:
    return [
        BandShown(name, BandScores.load(item.path), png_address(ScoreFiles(item.path).bands.read_bytes()))
        for name, item in zip(names, evals, strict=True)
        if (item.path / BandScores.FILE).is_file()
    ]


def _common_episodes(facts: ReportFacts) -> list[str]:
    """Episodes that every model was compared on.

    Raises:
        PlopError: There is none.
    """
    names = [name for name in facts.compared[0].episodes if all(name in c.episodes for c in facts.compared)]
    if not names:
        raise PlopError(
            "No episode was compared with every model.",
            where="report.comparisons",
            fix="Run `plop compare` on the same episodes for every model.",
        )
    return names


def _worst(facts: ReportFacts, names: list[str], most: int) -> list[str]:
    """Choose the episodes that can be looked at; they keep their order."""
    rows = {row.label: row.rms_mm for row in facts.compared[0].errors.tables.episode}
    chosen = sorted(names, key=lambda name: -rows[name])[:most]
    return [name for name in names if name in chosen]


def _episode(inputs: Inputs, recordings: RecordingSet, name: str, config: ReportConfig) -> dict[str, Any]:
    fields = read_fields(inputs, name)
    count = len(fields[0].times_s)
    frames = sorted({int(k) for k in np.linspace(0, count - 1, min(count, config.frames)).round()})
    packed = packed_episode(fields, frames)
    packed["images"] = episode_images(
        recordings.path(name),
        inputs["init"].path / name,
        fields[0].points_m[0].astype(float),
        fields[0].patch,
        [field.predicted_m.astype(float) for field in fields],
        frames,
        camera=config.camera,
        limit_mm=config.difference_mm,
    )
    return packed


def _summary(facts: ReportFacts, size_mb: float, names: list[str], shown: list[str]) -> Summary:
    episodes, over = judged_on(facts)
    found = [error_over(compared, episodes) for compared in facts.compared]
    rows = []
    for compared, error in zip(facts.compared, found, strict=True):
        share = closed_gap(found[0], error) if found[0] and error and error is not found[0] else None
        rows.append(
            {
                "model": compared.label,
                "over": over,
                "rms_mm": round(error["rms"], 3) if error else None,
                **{f"{b.key}_mm": round(error[b.key], 3) if error else None for b in BASELINES},
                "floor_mm": round(error["floor"], 3) if error else None,
                "way_to_floor_percent": round(100 * share, 1) if share and share > 0 else None,
            }
        )
    verdict = facts.diagnoses[0][1].verdict.kind if facts.diagnoses else "not diagnosed"
    figures = {
        "file": "report.html",
        "size_mb": round(size_mb, 2),
        "models": len(facts.compared),
        "episodes": len(names),
        "verdict": verdict,
    }
    if facts.diagnoses:
        figures["says"] = headline(*facts.diagnoses[0])
    warnings = beaten(facts)
    if len(shown) < len(names):
        warnings.append(f"The viewer shows the {len(shown)} worst of {len(names)} episodes; the tables contain all.")
    if size_mb > MOST_MB:
        warnings.append(f"The page has {size_mb:.0f} MB: lower report.frames or report.episodes to send it by mail.")
    return Summary(figures, rows, warnings)


def named_as_typed(config: ReportConfig, given: Mapping[str, str | Path]) -> ReportConfig:
    """Call the models as the user typed them, unless labels are given or one is an address."""
    names = tuple(name.strip() for name in str(given.get("models", "")).split(",") if name.strip())
    usable = len(set(names)) == len(names) and not any("@" in name for name in names)
    return replace(config, labels=names) if usable and not config.labels else config


def diagnoses_of(
    config: ReportConfig, found: Sequence[Artifact], inputs: Mapping[str, Sequence[Artifact]]
) -> list[Artifact]:
    """Choose among several diagnoses of one model: those that a model was made from, else the latest."""
    used = {key for model in inputs["models"] if (key := parents(model).get("diagnosis")) is not None}
    of = {a.key: parents(a).get("model") for a in found}
    answered = {of[key] for key in used if key in of}
    latest = {of[a.key]: a.key for a in found}
    return [a for a in found if a.key in used or (of[a.key] not in answered and latest[of[a.key]] == a.key)]


_OF_EACH_MODEL = Recipe({"recordings": "recordings", "init": "init", "model": "models"})

STAGE = Stage(
    name="report",
    version=13,
    help="Write one HTML file to send to a colleague: verdict, pictures, errors, parameters, provenance.",
    config=ReportConfig,
    inputs={
        "recordings": recordings_input("what was measured", Choice.UNAMBIGUOUS),
        "init": init_input("Gaussians at frame 0"),
        "models": InputSpec(MODELS, "the models, for their parameters", optional=True, choice=Choice.NAMED, many=True),
        "comparisons": InputSpec(
            ("compare",), "one for each model, the base first", choice=Choice.MADE, many=True, recipe=_OF_EACH_MODEL
        ),
        "diagnoses": InputSpec(
            ("diagnose",),
            "what was diagnosed",
            optional=True,
            choice=Choice.MATCHING,
            many=True,
            recipe=Recipe({"recordings": "recordings", "model": "models"}, makes=False),
            select=diagnoses_of,
        ),
        "evals": InputSpec(
            ("eval",), "scores of the models", optional=True, choice=Choice.MADE, many=True, recipe=_OF_EACH_MODEL
        ),
    },
    run=run,
    check_inputs=check_inputs,
    complete=named_as_typed,
)
