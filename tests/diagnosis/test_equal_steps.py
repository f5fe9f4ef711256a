"""A law is compared with a run without it in time steps of the same length."""

from __future__ import annotations

import numpy as np

from plop.diagnosis.evidence import moved
from plop.diagnosis.hypotheses import Hypothesis, candidates_of
from plop.diagnosis.responses import Job, run_job
from plop.diagnosis.table import Measured, Table
from plop.physics.effects.library import library
from tests.support.coarse_episodes import BASE, coarse_episode


def test_what_holds_cut_faces_together_does_nothing_where_nothing_is_cut():
    """Cohesion needs shorter time steps, which alone move what is pushed; in the same ones it does nothing."""
    types, episode = library(), coarse_episode(1)
    candidate = next(c for c in candidates_of(types) if c.effect == "cohesion")
    settings = ((candidate.columns[0], 1500.0),)
    law = Hypothesis(candidate, (1500.0,), ((settings, 1.0),))
    table = Table(Measured([episode]), BASE, lambda jobs: [run_job(job, types) for job in jobs])
    table.respond([settings])
    own, other = (run_job(Job(episode, BASE, each), types) for each in ((), settings))
    alone = moved(episode, other.points) - moved(episode, own.points)
    assert own.step_s > 1.5 * other.step_s and np.abs(alone).max() > 5e-5
    assert not np.any(table.response(law)[0])
