"""Calibration recovers the parameters that made a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial import cKDTree

from plop.errors import PlopError
from plop.physics.calibration.gauss_newton import calibrate
from plop.physics.calibration.least_squares import normal_equations, weighed
from plop.physics.calibration.posterior import Posterior, mean_squares
from plop.physics.calibration.recorded_motion import Case, case_from_sequence
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.fill import fill_surface
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.demo import CutPlan, demo_episode
from plop.physics.scenes.lattice import lattice
from plop.physics.scenes.tools import blade_mesh

CONFIG = EngineConfig(dx_m=0.012)


def sliding_case(block, material, speed, *, noise_m=0.0, seed=0) -> Case:
    """A block that slides while it sags, observed at every particle."""
    body = block((0.048, 0.036, 0.03), 0.006)
    velocity = np.tile([speed, 0.1 * speed, 0], (len(body), 1))
    extra = np.full(len(body), 1e-6 * body.volumes[0])
    particles = Particles(
        np.concatenate([body.positions] * 2), np.concatenate([body.volumes, extra]), np.concatenate([velocity] * 2)
    )
    away = np.eye(4)
    away[2, 3] = 1.0
    times = np.linspace(0, 0.12, 7)
    case = Case(
        "slide", particles, ToolMotion(*blade_mesh(), np.zeros(1), away[None]), times, np.zeros((6, len(body), 3)), 0.0
    )
    noise = np.random.default_rng(seed).normal(0, noise_m, case.observed.shape)
    return replace(case, observed=case.predict(material, CONFIG) + noise)


def test_recovers_stiffness_and_friction(block):
    truth = Material(youngs_modulus_pa=4e3, table_friction=0.3, damping_per_s=3)
    cases = [sliding_case(block, truth, s, noise_m=2e-4, seed=k) for k, s in enumerate((0.3, 0.5, -0.4, 0.2))]
    start = replace(truth, youngs_modulus_pa=8e3, table_friction=0.5)
    names = ["youngs_modulus_pa", "table_friction"]
    fit = calibrate(cases, start, names, CONFIG)
    assert fit.material.youngs_modulus_pa == pytest.approx(4e3, rel=0.03)
    assert fit.material.table_friction == pytest.approx(0.3, rel=0.03)
    assert fit.rms_after_m == pytest.approx(2e-4 * np.sqrt(3), rel=0.1)
    assert fit.rms_before_m > 5 * fit.rms_after_m
    for name, value in (("youngs_modulus_pa", 4e3), ("table_friction", 0.3)):
        estimate = fit.estimates[name]
        assert estimate.low < value < estimate.high
        assert estimate.high - estimate.low < 0.1 * value
    again = calibrate(cases, fit.material, names, CONFIG, prior=Posterior.around(start, names))
    assert again.rollouts == len(cases) * (1 + len(names))  # the derivatives promise nothing, so no step is tried


def test_a_parameter_that_nothing_feels_gets_an_infinite_interval(block):
    truth = Material(youngs_modulus_pa=4e3)
    fit = calibrate([sliding_case(block, truth, 0.3)], truth, ["tool_friction"], CONFIG, iterations=1)
    assert np.isinf(fit.estimates["tool_friction"].high)


def test_weighted_squares_have_the_gradient_of_the_log_density():
    generator = np.random.default_rng(0)
    residual = [scale * generator.normal(size=(3, 4, 3)) for scale in (1e-4, 1e-3, 5e-3)]
    jacobian = [[1e-3 * generator.normal(size=(3, 4, 3)) for _ in residual] for _ in range(2)]
    prior = Posterior.around(Material(), ("table_friction", "damping_per_s"))

    def cost(move):
        moved = [r + sum(m * row[e] for m, row in zip(move, jacobian, strict=True)) for e, r in enumerate(residual)]
        return prior.cost(prior.center + move, mean_squares(moved))

    _, gradient = normal_equations(*weighed(jacobian, residual))
    steps = 1e-4 * np.eye(2)
    np.testing.assert_allclose(gradient, [(cost(s) - cost(-s)) / 2e-4 for s in steps], rtol=1e-4)


def test_one_episode_that_goes_wrong_counts_little_and_many_count():
    """Between the sum of squares, which one episode decides, and the sum of logarithms, to which any slip is cheap."""
    prior = Posterior.around(Material(), ("table_friction",))

    def cost(*errors_mm):
        return prior.cost(prior.center, np.square(1e-3 * np.array(errors_mm)))

    assert cost(0.3, 0.3, 0.3, 0.3, 0.3, 2.0) < cost(0.7, 0.7, 0.7, 0.7, 0.7, 0.7)
    assert cost(0.4, 0.4, 0.4, 0.4, 0.7, 0.7) < cost(0.4, 0.25, 0.4, 0.4, 0.4, 1.7)
    assert cost(2, 4, 8) - cost(1, 2, 4) == pytest.approx(9 * np.log(2), rel=1e-3), "the scale is free"
    assert prior.cost(prior.center, np.array([1e-6, np.inf])) == np.inf


def test_of_two_fits_that_are_as_good_the_one_nearer_to_the_initial_value_is_likelier():
    prior = Posterior.around(Material(damping_per_s=2.0), ("damping_per_s",))
    assert prior.cost(np.array([3.0]), np.full(4, 1e-6)) < prior.cost(np.array([9.0]), np.full(4, 1e-6))
    assert prior.cost(np.array([9.0]), np.full(4, 1e-7)) < prior.cost(np.array([3.0]), np.full(4, 1e-6))


def test_bad_requests(block):
    with pytest.raises(PlopError, match="nothing to calibrate"):
        calibrate([], Material(), ["youngs_modulus_pa"], CONFIG)
    with pytest.raises(PlopError, match="nothing to calibrate"):
        calibrate([sliding_case(block, Material(), 0.3)], Material(), ["youngs_modulus"], CONFIG)


def test_filled_surface_has_the_volume_and_middle_of_the_solid():
    grid = lattice((2, 2, 2))
    sheared = grid.parameters * [0.05, 0.03, 0.04] + grid.parameters[:, 2:] * [0.01, 0.004, 0]
    positions, volumes, radii = fill_surface(sheared, grid.faces, 0.005)
    assert volumes.sum() == pytest.approx(0.05 * 0.03 * 0.04, rel=0.02)
    np.testing.assert_allclose(volumes @ positions / volumes.sum(), sheared.mean(0), atol=5e-4)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(sheared.astype(np.float32)), o3d.core.Tensor(grid.faces.astype(np.uint32)))
    away = np.abs(scene.compute_signed_distance(o3d.core.Tensor(positions.astype(np.float32))).numpy())
    assert away[radii == 0].max() < 1e-6 and (radii == 0).sum() > 0.3 * len(radii), "the outer ones lie on the surface"
    assert away[radii > 0].min() > 0.002
    assert cKDTree(positions).query(positions, k=2)[0][:, 1].min() > 0.001


def test_case_of_a_cut_surface_knows_its_sides():
    case = case_from_sequence(demo_episode("x", CutPlan(0.004, 0.1, 0.1, 0.02, 0.07)), 0.006)
    material = slice(None, case.tracers.start)
    ahead = case.particles.positions[material] @ [np.cos(0.1), np.sin(0.1), 0] - 0.004 * np.cos(0.1)
    clear = np.abs(ahead) > 1e-4  # both halves have particles on the cut itself
    assert ((case.particles.sides[material] > 0) == (ahead > 0))[clear].mean() > 0.99
    assert clear.mean() > 0.7
    assert case.particles.volumes.sum() == pytest.approx(0.08 * 0.05 * 0.04, rel=0.01)
