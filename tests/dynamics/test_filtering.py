"""The filter finds a motion that it was not told."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.filter.particle_filter import UpdateConfig, run_filter
from plop.dynamics.resampling import ResamplingConfig, resample
from plop.gaussians.covariance import scales_quats_from_covariance
from plop.recordings.recording import Recording
from tests.support.small_episode import PUSH_M, write_episode


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    folder = tmp_path_factory.mktemp("episode")
    states = write_episode(folder, "push")
    return folder / "push.h5", states


def filtered(path, initial, model):
    config = UpdateConfig(iterations=30, views=3, cells_across=5)
    with Recording(path) as recording:
        return list(run_filter(model, recording, initial, config))


def test_the_pushed_half_is_followed(episode):
    path, states = episode
    steps = filtered(path, states[0], ConstantVelocity())
    last = steps[-1].updated.gaussians.means
    moved = (states[-1].means - states[0].means).norm(dim=-1) > 0
    persistence = (states[0].means - states[-1].means)[moved].norm(dim=-1).mean()
    error = (last - states[-1].means).norm(dim=-1)
    assert persistence == pytest.approx(3 * PUSH_M, rel=1e-3)
    assert error[moved].mean() < 0.35 * persistence
    assert error[~moved].mean() < 0.2 * persistence


def test_the_update_lowers_the_innovation(episode):
    path, states = episode
    steps = filtered(path, states[0], ConstantVelocity(keep=0))

    def mean_of(term: str, first: int, last: int) -> float:
        rows = [c[term] for s in steps if first <= s.frame <= last for c in s.innovation.values()]
        return sum(rows) / len(rows)

    # Before the push nothing is wrong: what is left there is the error of images and masks themselves.
    floor = mean_of("updated_l1", 1, 2)
    assert mean_of("updated_l1", 3, 5) - floor < 0.5 * (mean_of("l1", 3, 5) - floor)


def test_lineage_is_kept(episode):
    path, states = episode
    steps = filtered(path, states[0], ConstantVelocity(keep=0))
    assert torch.equal(steps[-1].updated.gaussians.ids, states[0].ids)


class Splitting(ConstantVelocity):
    """A model that moves nothing and splits three Gaussians in every step."""

    def step(self, state, action, *, generator=None):
        config = ResamplingConfig(split_above=1.0, merge_below=0.0, max_count=len(state.side) + 3)
        return resample(ConstantVelocity(keep=0).step(state, action), config, generator=generator)


def test_the_update_follows_gaussians_that_split(episode):
    path, states = episode
    initial = states[0].with_(scales=states[0].scales * (1 + 0.1 * torch.rand(len(states[0]), 3)))
    steps = filtered(path, initial, Splitting())
    assert [len(s.updated.side) for s in steps] == [len(initial) + 3 * s.frame for s in steps]
    last = steps[-1].updated.gaussians
    assert (last.means - initial.means[last.ids]).norm(dim=-1).max() < 0.02


class Rewritten:
    """A model that moves nothing and writes the same shapes otherwise, as whatever decomposes covariances does."""

    def step(self, state, action, *, generator=None):
        scales, quats = scales_quats_from_covariance(state.gaussians.covariances)
        after = ConstantVelocity(keep=0).step(state, action)
        return replace(after, gaussians=after.gaussians.with_(scales=scales, quats=quats))


def test_shapes_are_those_of_the_prediction_however_it_writes_them(episode):
    path, states = episode
    scales = torch.tensor([0.004, 0.001, 0.002]) * (1 + 0.1 * torch.rand(len(states[0]), 3))
    initial = states[0].with_(scales=scales)
    plain, rewritten = (
        filtered(path, initial, model)[-1].updated.gaussians for model in (ConstantVelocity(keep=0), Rewritten())
    )
    apart = (rewritten.covariances - plain.covariances).norm(dim=(1, 2)) / plain.covariances.norm(dim=(1, 2))
    assert apart.mean() < 0.02  # 1.2 where shapes and turns of two decompositions are mixed
