"""Residuals in units of what is expected: the misfit is recovered; what was hidden does not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.evidence import FRAMES, MisfitModel, compared_frames, corrected, octants, whiten
from tests.support.synthetic_evidence import LAWS, NOISE_M, episodes, key

KEYS = [key(law) for law in LAWS]


@pytest.mark.parametrize("misfit_m", [0.0, 2e-4, 1e-3])
def test_misfit_is_recovered_beside_the_noise(misfit_m):
    model = MisfitModel.of(episodes(3, count=20, rough_m=misfit_m))
    found = float(np.median(model.misfit_m))
    assert found == pytest.approx(misfit_m, rel=0.1, abs=0.4 * NOISE_M)


def test_misfit_grows_with_the_motion_and_never_falls():
    data = []
    for e in episodes(4, count=20):
        size = np.linalg.norm(e.motion, axis=-1, keepdims=True)
        noise = np.random.default_rng(len(data)).normal(size=e.residual.shape)
        data.append(replace(e, residual=e.residual + 0.2 * size * noise))
    model = MisfitModel.of(data)
    assert (np.diff(model.misfit_m) >= 0).all()
    for at in (2e-3, 5e-3):
        assert model.at(np.array(0.01 * at)) == pytest.approx(0.2 * at, rel=0.35)


def test_whitened_residuals_have_unit_variance():
    data = episodes(5, count=20, rough_m=5e-4)
    model = MisfitModel.of(data)
    squares = [(whiten(e, model, KEYS).residual ** 2).mean() for e in data]
    assert np.mean(squares) == pytest.approx(1, abs=0.1)


def test_a_few_wild_residuals_do_not_widen_the_misfit():
    data = episodes(6, count=10, rough_m=5e-4)
    wild = [replace(e, residual=np.where(np.arange(len(e.noise_m))[:, None] < 3, 0.05, e.residual)) for e in data]
    plain, spoilt = (np.median(MisfitModel.of(d).misfit_m) for d in (data, wild))
    assert spoilt == pytest.approx(plain, rel=0.25)


def test_hidden_patches_change_neither_the_misfit_nor_the_mean_error():
    data = episodes(7, count=20, rough_m=5e-4)
    seen = np.random.default_rng(0).uniform(size=(*data[0].residual.shape[:2], 1)) < 0.4
    hidden = [replace(e, residual=e.residual * seen) for e in data]
    plain, fewer = MisfitModel.of(data), MisfitModel.of(hidden)
    np.testing.assert_allclose(fewer.misfit_m, plain.misfit_m, rtol=0.3)
    white = [whiten(e, fewer, KEYS) for e in hidden]
    assert sum((w.residual**2).sum() for w in white) / sum(w.count for w in white) == pytest.approx(1, abs=0.15)


def test_nothing_seen_is_no_misfit():
    data = [replace(e, residual=np.zeros_like(e.residual)) for e in episodes(8, count=2)]
    model = MisfitModel.of(data)
    assert model.at(data[0].doubt_m).max() == 0
    assert np.isfinite(whiten(data[0], model, KEYS).residual).all()


def test_a_mixture_is_taken_off():
    one, plain = (episodes(9, mix, count=1)[0] for mix in ({"tilt": 2.0, "drag": -1.0}, {}))
    values = np.array([{"tilt": 2.0, "drag": -1.0}.get(law, 0.0) for law in LAWS])
    np.testing.assert_allclose(corrected(one, KEYS, values).residual, plain.residual, atol=1e-12)


def test_compared_frames_are_spread_and_never_the_first():
    assert compared_frames(3).tolist() == [1, 2]
    many = compared_frames(100)
    assert (many[0], many[-1], len(many)) == (1, 99, FRAMES)


def test_octants_are_eight_parts_about_the_median():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    assert sorted(octants(corners).tolist()) == list(range(8))


def test_parts_of_the_object_flip_together_and_add_up():
    white = whiten(episodes(10, count=1)[0], MisfitModel(np.ones(1), np.zeros(1)), KEYS)
    signs = np.array([1.0, -1, 1, -1, 1, -1, 1, -1])
    flipped = white.flipped(signs)
    per_patch = (flipped.residual / white.residual).reshape(*white.shape, 3)
    np.testing.assert_array_equal(per_patch, np.broadcast_to(signs[white.block][:, None], per_patch.shape))
    assert white.by_block(white.residual**2).sum() == pytest.approx((white.residual**2).sum())
