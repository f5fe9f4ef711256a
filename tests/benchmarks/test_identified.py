"""benchmarks.worlds.identified: what is left of the engine's own recordings is their noise."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.worlds.identified import misses, model_errors
from plop.parameters import Estimate
from plop.physics.calibration.material_parameters import PARAMETERS
from tests.support.coarse_episodes import BASE, coarse_episode


def test_the_error_is_of_what_is_compared_and_beside_its_noise_and_motion() -> None:
    found = misses([coarse_episode(0), coarse_episode(1)], BASE, jobs=1)
    assert found["rms_mm"] == pytest.approx((sum(e**2 for e in found["episodes_mm"]) / 2) ** 0.5)
    assert 0.1 < found["noise_mm"] < 0.35  # 0.2 mm of a coordinate, over the points of a patch, in three coordinates
    assert found["noise_mm"] < found["rms_mm"] < found["moved_mm"]


def test_the_error_of_the_engine_is_what_fits_scatter_beyond_their_own_intervals() -> None:
    random, rows = np.random.default_rng(0), []
    for _ in range(200):
        fits = {"youngs_modulus_pa": random.normal(0, [0.3, 0.1]), "table_friction": random.normal(0, [0.2, 0.05])}
        declared = {"youngs_modulus_pa": 2e4, "table_friction": 0.9}
        estimates = {}
        for name, errors in fits.items():
            parameter = PARAMETERS[name]
            middle, half = parameter.encode(declared[name]) + errors.sum(), 1.96 * (0.1 if "modulus" in name else 0.05)
            estimates[name] = Estimate(*(parameter.decode(middle + x) for x in (0.0, -half, half)))
        rows.append({"declared": declared, "estimates": {name: each.to_json() for name, each in estimates.items()}})
    found = model_errors(rows)
    assert found["youngs_modulus_pa"]["error"] == pytest.approx(0.3, rel=0.15)
    assert found["friction"] == {"error": pytest.approx(0.2, rel=0.15), "n": 200}
    for row in rows:  # `identify` adds the error to its intervals: what is found beyond them stays the same
        row["model_errors"] = {name: PARAMETERS[name].model_error for name in row["declared"]}
        wider = {n: Estimate.from_json(e).with_model_error(PARAMETERS[n]) for n, e in row["estimates"].items()}
        row["estimates"] = {name: each.to_json() for name, each in wider.items()}
    again = model_errors(rows)
    assert [again[kind]["error"] for kind in found] == pytest.approx([found[kind]["error"] for kind in found], rel=1e-3)
