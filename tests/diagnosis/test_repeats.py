"""Repeats of a motion have the same patches, in whatever points each was followed, and the same responses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from trimesh import Trimesh

from plop.diagnosis.evidence.discrepancy import path_distances
from plop.diagnosis.evidence.evidence import foot_of, tool_path
from plop.diagnosis.evidence.noise import repeats_of
from plop.diagnosis.responses.hypotheses import candidates_of, hypotheses_of
from plop.diagnosis.responses.job import Answer, Job, run_job
from plop.diagnosis.responses.repeats import share_responses, with_shared_patches
from plop.diagnosis.responses.table import Measured, Table
from plop.diagnosis.rule import RULE
from plop.physics.effects.library import library
from plop.physics.scenes.scene import simulate_episode
from plop.tracking.episode import episode_from_sequence
from tests.support.coarse_episodes import BASE, SCENE


def followed(k: int, seed: int, points: int = 150):
    return episode_from_sequence(simulate_episode(SCENE, k), noise_m=1e-4, seed=seed, points=points)


def middles(episode):
    counts = np.bincount(episode.patch, minlength=episode.patches)
    assert (counts > 0).all()
    return np.stack([np.bincount(episode.patch, v, episode.patches) for v in episode.points[0].T], 1) / counts[:, None]


def test_repeats_get_the_patches_of_the_first_and_others_keep_their_own():
    first, again, other = followed(0, 1), followed(0, 2, points=170), followed(1, 3)
    here, reference = with_shared_patches(Measured([first, other]), Measured([again]))
    (found, unlike), (repeat,) = here.episodes, reference.episodes
    assert found is first and unlike is other
    assert repeat.patches == first.patches != again.patches and len(repeat.patch) == 170
    nearest = cKDTree(middles(again)).query(middles(first))[0].mean()
    assert np.linalg.norm(middles(repeat) - middles(first), axis=1).mean() < 0.8 * nearest < 0.01


def test_an_episode_with_fewer_points_than_patches_keeps_its_own():
    first, few = followed(0, 1), followed(0, 2, points=30)
    many = replace(first, patch=np.arange(150))
    assert with_shared_patches(Measured([many]), Measured([few]))[1].episodes[0] is few


@pytest.mark.parametrize("k", [0, 1])
def test_an_episode_is_its_own_repeat(k):
    same, repeat = (m.episodes[0] for m in with_shared_patches(Measured([followed(k, 1)]), Measured([followed(k, 1)])))
    np.testing.assert_array_equal(same.patch, repeat.patch)


def test_a_repeat_is_one_whatever_mesh_the_object_was_given():
    """Measured anew, an object has many vertices where it had few: its foot stays where it was."""
    one = followed(0, 1)
    mesh = Trimesh(one.vertices, one.faces, process=False)
    finer = mesh.subdivide(np.flatnonzero(mesh.triangles_center[:, 0] > mesh.centroid[0]))
    other = replace(one, vertices=np.asarray(finer.vertices), faces=np.asarray(finer.faces))
    size = np.ptp(one.vertices, axis=0).max()
    assert np.linalg.norm(one.vertices.mean(0) - other.vertices.mean(0)) > 0.05 * size
    np.testing.assert_allclose(foot_of(other), foot_of(one), atol=1e-6)
    distances = path_distances([tool_path(e) for e in (one, other)], [1.0, 1.0])
    assert distances[0, 1] < 1e-3 and len(repeats_of(distances)) == 1


def test_a_law_is_run_once_for_each_motion():
    types, asked = library(), list[Job]()
    law = next(h for h in hypotheses_of(candidates_of(types)) if h.effect == "stiffness")

    def run(jobs: list[Job]) -> list[Answer]:
        asked.extend(job for job in jobs if job.settings)
        return [run_job(job, types) for job in jobs]

    given = with_shared_patches(Measured([followed(0, 1), followed(1, 3)]), Measured([followed(0, 2)]))
    again = given[1].episodes[0]
    hidden = np.repeat((again.patch == 0)[None], len(again.times), 0)
    given[1].episodes[0] = replace(again, seen=~hidden)
    finer = replace(BASE, spacing_m=0.007)  # particles 10 mm apart answer 28 % otherwise where they lie otherwise
    tables = [Table(each, finer, run) for each in given]
    share_responses(tables)
    for table in tables:
        table.respond([law])
    assert [job.episode.name for job in asked] == [e.name for e in given[0].episodes]
    (own, other), (repeat,) = (table.response(law) for table in tables)
    seen = tables[1].evidence[0].seen
    assert not seen.all() and other.shape != own.shape
    np.testing.assert_array_equal(repeat, own * seen[..., None])
    by_itself = Table(given[1], finer, run)
    by_itself.respond([law])
    (itself,) = by_itself.response(law)
    assert np.linalg.norm(itself - repeat) < RULE.response_error * np.linalg.norm(itself), "in points of its own"


def test_a_repeat_with_other_patches_is_run_by_itself():
    types, asked = library(), list[str]()
    law = next(h for h in hypotheses_of(candidates_of(types)) if h.effect == "stiffness")

    def run(jobs: list[Job]) -> list[Answer]:
        asked.extend(job.key for job in jobs if job.settings)
        return [run_job(job, types) for job in jobs]

    many, few = replace(followed(0, 1), patch=np.arange(150)), followed(0, 2, points=30)
    table = Table(Measured([many, few]), BASE, run)
    share_responses([table])
    table.respond([law])
    assert len(asked) == 2 and [r.shape[1] for r in table.response(law)] == [150, few.patches]
