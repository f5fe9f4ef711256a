"""What the engine says of motions: of those that were recorded, and of those that are made from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from plop.diagnosis.evidence.evidence import evidence_of
from plop.diagnosis.responses.hypotheses import Hypothesis, Settings
from plop.diagnosis.responses.job import Job
from plop.diagnosis.responses.table import Measured, Table
from plop.errors import PlopError
from plop.planning.motions import Change, Motion, as_expected, planned_episode
from plop.tracking.episode import Episode


def recorded_motion(table: Table, k: int, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]) -> Motion:
    """Describe a motion that was recorded."""
    episode, evidence = table.episodes[k], table.evidence[k]
    columns = [table.response(h)[k] for h in own]
    stacked = np.stack(columns, -1) if columns else np.zeros((*evidence.residual.shape, 0))
    responses = tuple(table.response(h)[k] for h in hypotheses)
    return Motion(episode.name, episode.name, Change.NONE, episode.tool, table.kinds[k], evidence, stacked, responses)


def varied_motions(
    table: Table,
    motions: Sequence[Motion],
    hypotheses: Sequence[Hypothesis],
    own: Sequence[Hypothesis],
    vary: Sequence[Change],
    dropped: dict[str, str],
) -> list[Motion]:
    """Run the motions of the family: of each kind of recorded motion, the first, with its path changed in every way."""
    sources: dict[str, int] = {}
    for k, motion in enumerate(motions):
        sources.setdefault(motion.kind, k)
    planned = [
        (k, change, episode)
        for k in sources.values()
        for change in vary
        if change != Change.NONE and (episode := planned_episode(table.episodes[k], change)) is not None
    ]
    engines = dict.fromkeys([table.base, table.survey.base])
    table.run_jobs([Job(episode, engine) for _, _, episode in planned for engine in engines])  # at the same time
    alone, found = [], []
    for k, change, episode in planned:
        with _dropping(episode, dropped):
            alone.append((k, change, _alone(table, episode)))
    settings = dict.fromkeys(_settings([*hypotheses, *own]))
    table.run_jobs([job for _, _, each in alone for law in settings for job in each.survey.jobs(law).values()])
    for k, change, each in alone:
        with _dropping(each.episodes[0], dropped):
            found.append(_run(table, k, change, each, hypotheses, own))
    return found


def with_more(
    table: Table, motions: Sequence[Motion], motion: Motion, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]
) -> Motion:
    """Run more laws in a motion that is not one of those that were recorded."""
    if motion in motions:
        return motion
    k = next(k for k, each in enumerate(motions) if each.name == motion.like)
    episode = planned_episode(table.episodes[k], motion.change)
    assert episode is not None
    return _run(table, k, motion.change, _alone(table, episode), hypotheses, own)


def _run(
    table: Table, k: int, change: Change, alone: Table, hypotheses: Sequence[Hypothesis], own: Sequence[Hypothesis]
) -> Motion:
    """Describe a planned motion.

    Raises:
        PlopError: The engine cannot follow it, with every law.
    """
    alone.respond([*hypotheses, *own])
    if alone.failed:
        raise PlopError("The engine cannot follow it.", found="; ".join(alone.failed.values())[:200])
    episode = alone.episodes[0]
    made = recorded_motion(alone, 0, hypotheses, own)
    evidence = as_expected(evidence_of(episode, alone.plain[0][:1]), table.evidence[k])
    return replace(made, like=table.episodes[k].name, change=change, evidence=evidence)


def _alone(table: Table, episode: Episode) -> Table:
    """Run the engine without laws through a planned motion.

    Raises:
        PlopError: It cannot follow it.
    """
    survey = None if table.survey is table.full else table.survey.base
    return Table(Measured([episode], {episode.name: [episode.points]}), table.base, table.run_jobs, survey)


@contextmanager
def _dropping(episode: Episode, dropped: dict[str, str]) -> Iterator[None]:
    """Leave an episode out that the engine cannot follow."""
    try:
        yield
    except PlopError as error:
        dropped[episode.name] = f"{error.problem} {error.found or ''}".strip()


def _settings(hypotheses: Iterable[Hypothesis]) -> list[Settings]:
    return [settings for hypothesis in hypotheses for settings, _ in hypothesis.runs]
