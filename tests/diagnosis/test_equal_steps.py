"""A law is compared with a run without it in time steps of the same length; where it can do nothing it is not run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.diagnosis.evidence.evidence import moved
from plop.diagnosis.responses.hypotheses import Hypothesis, candidates_of
from plop.diagnosis.responses.job import Answer, Job, run_job
from plop.diagnosis.responses.table import Measured, Table
from plop.physics.effects.library import library
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.tools import box_mesh
from tests.support.coarse_episodes import BASE, coarse_episode


def cohesion(needs_blade: bool) -> Hypothesis:
    candidate = next(c for c in candidates_of(library()) if c.effect == "cohesion")
    column = replace(candidate.columns[0], needs_blade=needs_blade)
    return Hypothesis(replace(candidate, columns=(column,)), (1500.0,), ((((column, 1500.0),), 1.0),))


def test_what_holds_cut_faces_together_does_nothing_where_nothing_is_cut():
    """Cohesion needs shorter time steps, which alone move what is pushed; in the same ones it does nothing."""
    types, episode, law = library(), coarse_episode(1), cohesion(needs_blade=False)
    settings = law.runs[0][0]
    table = Table(Measured([episode]), BASE, lambda jobs: [run_job(job, types) for job in jobs])
    table.respond([law])
    own, other = (run_job(Job(episode, BASE, each), types) for each in ((), settings))
    alone = moved(episode, other.points) - moved(episode, own.points)
    assert own.step_s > 1.5 * other.step_s and np.abs(alone).max() > 5e-5
    assert not np.any(table.response(law)[0])


def test_a_law_of_cuts_is_run_only_where_the_tool_is_a_blade():
    types, whole = library(), coarse_episode(1)
    mesh = box_mesh((0.002, 0.05, 0.05))
    tool = ToolMotion(*mesh, whole.tool.times, whole.tool.world_from_tool)
    blade, law, asked = replace(whole, tool=tool, name="cut"), cohesion(needs_blade=True), list[Job]()

    def run(jobs: list[Job]) -> list[Answer]:
        asked.extend(jobs)
        return [run_job(job, types) for job in jobs]

    table = Table(Measured([whole, blade]), BASE, run)
    table.respond([law])
    assert [job.episode.name for job in asked if job.settings] == ["cut"]
    none, some = table.response(law)
    assert none.shape == table.evidence[0].residual.shape and not none.any() and some.shape == none.shape
    assert {c.effect for c in candidates_of(types) if c.columns[0].needs_blade} == {"cohesion", "toughness"}
