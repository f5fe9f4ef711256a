"""The cohesive zone between the faces of a cut: its energy, what is gone, what it leaves alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.responses.hypotheses import candidates_of
from plop.parameters import Parameter
from plop.physics.effects.cohesion import Cohesion
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.fill import fill_surface
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import EngineTrajectory, simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.shapes import Shape, halved_body, whole_body
from plop.physics.scenes.tools import blade_mesh

SIDE_M, TRACTION_PA, OPENING_M = 0.03, 150.0, 0.004
SPIN_PER_S = (0, 0, 4.0)
BLOCK = Shape("block", (0.06, 0.03, 0.03))
SOFT = Material(youngs_modulus_pa=2e4, poisson=0.3, damping_per_s=2, tool_friction=0, cut_friction=0)


class Grips(Effect):
    """Springs that hold the outer cells of both halves to jaws; the jaws' way apart follows `path`."""

    name = "grips"
    help = law = source = "test"
    amplitudes = (Parameter("n_m", "N/m", 0.0, 1e6, step=1.0, typical=10.0),)

    def __init__(self, path: Callable[[float], float], **values: float) -> None:
        super().__init__(n_m=20.0, **values)
        self.path, self.time, self.work, self.log = path, 0.0, 0.0, []

    def before(self, body, dt):
        if not self.time:
            self.home = np.zeros((body.number.max() + 1, 3), np.float32)
            self.home[body.number] = body.x
            self.reach = np.abs(body.x[:, 0]).max() - 0.006
        home = self.home[body.number]
        sign = np.sign(home[:, 0]) * (np.abs(home[:, 0]) > self.reach)
        rate = (self.path(self.time + dt) - self.path(self.time)) / dt / 2
        self.time += dt
        jaw = home + sign[:, None] * [self.path(self.time) / 2, 0, 0]
        force = np.where(sign[:, None] != 0, self["n_m"] * (jaw - body.x), 0).astype(np.float32)
        body.v += (dt * force / body.mass[:, None]).astype(np.float32)
        self.work += dt * rate * float(force[:, 0] @ sign)
        self.log.append((self.path(self.time), float(force[:, 0] @ (sign > 0))))


def faces(spacing: float, *, nodes: bool = False) -> Particles:
    """Two halves that a blade has just passed at x = 0 and a film still joins."""

    def axis(low, high, n):
        return np.linspace(low, high, n + 1) if nodes else low + (high - low) * (np.arange(n) + 0.5) / n

    def share(n):
        return np.r_[0.5, np.ones(n - 1), 0.5] / n if nodes else np.full(n, 1 / n)

    n = round(SIDE_M / spacing)
    parts, volumes = [], []
    for low, high in ((-SIDE_M, 0.0), (0.0, SIDE_M)):
        grid = np.meshgrid(axis(low, high, n), *2 * [axis(-SIDE_M / 2, SIDE_M / 2, n)], indexing="ij")
        parts.append(np.stack(grid, -1).reshape(-1, 3))
        volumes.append(np.einsum("i,j,k->ijk", *3 * [share(n)]).ravel() * SIDE_M**3)
    half = len(parts[0])
    places, number = np.concatenate(parts), np.arange(2 * half)
    near = np.abs(places[:, 0]) < 0.75 * spacing
    away = ((places[:, None] * [-1, 1, 1] - places[None]) ** 2).sum(-1)
    other = np.where(number[None] // half != number[:, None] // half, away, 1.0).argmin(1)
    sign = np.repeat([-1.0, 1.0], half)
    memory = {
        "cohesion.partner": np.where(near, other + 1.0, -1.0),
        "cohesion.share": 1 - np.abs(places[:, 0]) / spacing,
        "cohesion.rest": places - places[other],
        "cohesion.normal": sign[:, None] * [1.0, 0, 0],
        "cohesion.strength": np.ones(2 * half),
        "cohesion.peak": np.zeros(2 * half),
    }
    return Particles(
        places,
        np.concatenate(volumes),
        sides=sign,
        passed=np.ones(2 * half, bool),
        radii=np.zeros(2 * half) if nodes else None,
        memory=memory,
    )


def smooth(share: float) -> float:
    """Go from 0 to 1 without a jerk."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3 - 2 * share)


FREE = {"gravity_m_s2": (0, 0, 0), "table_z_m": None}


def pull(
    law: Cohesion, path: Callable[[float], float], end_s: float, spacing: float = 0.005, *, nodes: bool = False
) -> Grips:
    grips = Grips(path)
    simulate(
        faces(spacing, nodes=nodes),
        SOFT,
        None,
        np.array([0, end_s]),
        EngineConfig(dx_m=2 * spacing, **FREE),
        effects=[law, grips],
    )
    return grips


LAW = Cohesion(traction_pa=TRACTION_PA, opening_m=OPENING_M)
ENERGY_J = LAW.energy_j_m2 * SIDE_M**2


@pytest.mark.parametrize(
    ("spacing", "way_s", "nodes"),
    [
        (0.005, 0.3, False),
        (0.003, 0.3, False),
        (0.005, 0.6, False),
        (0.005, 0.15, False),
        (0.005, 0.3, True),
        (0.00375, 0.3, True),
    ],
)
def test_the_work_of_pulling_apart_is_the_energy_of_separation(spacing, way_s, nodes):
    grips = pull(LAW, lambda t: 0.007 * smooth(t / way_s), way_s + 0.1, spacing, nodes=nodes)
    assert grips.work == pytest.approx(ENERGY_J, rel=0.05)
    assert 0.9 < max(force for _, force in grips.log) / (TRACTION_PA * SIDE_M**2) < 1.35


def test_the_energy_is_spent_once_however_often_the_faces_open():
    def path(t):
        return 0.002 * smooth(t / 0.2) - 0.001 * smooth((t - 0.2) / 0.2) + 0.006 * smooth((t - 0.4) / 0.4)

    assert pull(LAW, path, 0.9).work == pytest.approx(ENERGY_J, rel=0.05)


def test_a_crack_that_was_closed_again_has_not_healed():
    def path(t):
        return 0.007 * (smooth(t / 0.2) - smooth((t - 0.25) / 0.2) + smooth((t - 0.5) / 0.2))

    held, loose = (np.array(pull(law, path, 0.8).log) for law in (LAW, Cohesion(traction_pa=1e-3)))
    late = np.linspace(0, 0.8, len(held)) > 0.5
    # the blow with which the faces have met makes both swing a little
    assert held[late, 1].max() == pytest.approx(loose[late, 1].max(), abs=0.02 * TRACTION_PA * SIDE_M**2)
    assert held[late, 1].max() < 0.15 * TRACTION_PA * SIDE_M**2


def free_flight(start: Particles, velocities: np.ndarray, end_s: float, *laws: Effect) -> EngineTrajectory:
    """Let two halves go with the given velocities, without table or weight."""
    body = replace(start, velocities=velocities)
    loose = Material(youngs_modulus_pa=2e4, poisson=0.3, cut_friction=0)
    return simulate(body, loose, None, np.array([0, end_s]), EngineConfig(dx_m=0.01, **FREE), effects=laws)


def test_faces_that_are_pressed_together_feel_nothing():
    start = faces(0.005)
    # only for as long as it takes until they bounce back
    plain, held = (free_flight(start, -0.02 * start.sides[:, None] * [1, 0, 0], 0.01, *e) for e in ([], [LAW]))
    np.testing.assert_allclose(held.positions, plain.positions, atol=2e-5)
    assert np.abs(plain.positions[-1] - plain.positions[0]).max() > 1e-4
    assert held.final.memory["cohesion.peak"].max() < 0.02 * OPENING_M


def test_a_turning_body_opens_no_bond():
    start = faces(0.005)
    run = free_flight(start, np.cross(SPIN_PER_S, start.positions), 0.1, LAW)
    # centrifugal force alone opens them by 0.04 mm; ways that do not turn along would open by 2 mm
    assert run.final.memory["cohesion.peak"].max() < 3e-4
    turned = np.arctan2(run.positions[-1, -1, 1], run.positions[-1, -1, 0]) - np.arctan2(0.0125, 0.0275)
    assert turned > 0.3, "particles that start without spin of their own take some of it"


def test_momentum_is_kept():
    start = faces(0.005)
    velocities = start.sides[:, None] * [0.03, 0.02, -0.01] + [0.05, 0, 0.02]
    run = free_flight(start, velocities, 0.04, LAW)
    before, after = (start.volumes @ v / start.volumes.sum() for v in (velocities, run.final.velocities))
    np.testing.assert_allclose(after, before, atol=2e-5)
    apart = [v[start.sides > 0, 0].mean() - v[start.sides < 0, 0].mean() for v in (velocities, run.final.velocities)]
    assert apart[1] < 0.5 * apart[0], "and yet the faces pulled"


def blade(yaw_deg: float, x_m: float, *aside: float) -> ToolMotion:
    """Down through the middle of a block in 0.3 s, then aside along the blade's normal."""
    cos, sin = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
    poses = np.tile(np.eye(4), (2 + len(aside), 1, 1))
    poses[:, :2, :2] = [[cos, -sin], [sin, cos]]
    way = np.array([0, 0, *aside])
    poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = x_m + way * cos, way * sin, [0.034, *[-0.005] * (1 + len(aside))]
    return ToolMotion(*blade_mesh(), 0.3 * np.arange(len(poses)), poses)


def cells(block) -> Particles:
    return block(BLOCK.size_m, 0.005)


def filled(_) -> Particles:
    whole = whole_body(BLOCK, 0.005)
    places, volumes, radii = fill_surface(whole.particles.positions[whole.surface], whole.faces, 0.005)
    return Particles(places, volumes, radii=radii)


@pytest.mark.parametrize("fill", [cells, filled])
@pytest.mark.parametrize(("yaw_deg", "x_m"), [(0, 0.0), (0, 0.0012), (0, 0.0025), (8, 0.001), (20, 0.002), (45, 0.0)])
def test_the_blade_joins_the_area_that_it_has_cut(block, fill, yaw_deg, x_m):
    body = fill(block)
    run = simulate(
        body,
        SOFT,
        blade(yaw_deg, x_m),
        np.array([0, 0.3]),
        EngineConfig(dx_m=0.01),
        effects=[Cohesion(traction_pa=1, opening_m=0.05)],
    )
    memory = run.final.memory
    joined = memory["cohesion.partner"] > 0
    area = (memory["cohesion.share"] * body.volumes)[joined].sum() / np.cbrt(body.volumes.max())
    assert area == pytest.approx(0.03**2 / np.cos(np.deg2rad(yaw_deg)), rel=0.1)


@pytest.mark.parametrize(("x_m", "yaw_deg"), [(0.0, 0.0), (0.004, 8.0), (-0.007, 15.0)])
def test_halves_that_were_made_apart_are_joined_over_the_area_of_their_faces(x_m, yaw_deg):
    body = halved_body(BLOCK, 0.005, x_m, np.deg2rad(yaw_deg)).particles
    run = simulate(
        body,
        SOFT,
        blade(yaw_deg, x_m),
        np.array([0, 0.3]),
        EngineConfig(dx_m=0.01),
        effects=[Cohesion(traction_pa=1, opening_m=0.05)],
    )
    share = np.where(run.final.memory["cohesion.partner"] > 0, run.final.memory["cohesion.share"], 0)
    area = (share * body.volumes).sum() / np.cbrt(body.volumes.max())
    assert area == pytest.approx(0.03**2 / np.cos(np.deg2rad(yaw_deg)), rel=0.1)


def test_what_holds_together_is_dragged_along_unless_the_blade_has_worn_it(block):
    body = block((0.06, 0.03, 0.03), 0.005)
    left = body.positions[:, 0] < 0

    def moved(*laws):
        run = simulate(body, SOFT, blade(0, 0.0, 0.008), np.array([0, 0.6]), EngineConfig(dx_m=0.01), effects=laws)
        return (run.positions[-1] - body.positions)[left, 0].mean(), run.final.memory

    plain, _ = moved()
    held, _ = moved(Cohesion(traction_pa=800, opening_m=0.02))
    worn, memory = moved(Cohesion(traction_pa=800, opening_m=0.02, wear=1.0))
    assert abs(plain) < 0.0005 and held > 0.002 and worn < 0.3 * held
    assert (memory["cohesion.strength"] < 0.05).any()


def test_a_bond_whose_partner_is_left_out_is_gone():
    start = faces(0.005)
    for side in (-1, 1):  # the partners' numbers are beyond the end, or are those of others
        half = start.select(np.flatnonzero(start.sides == side))
        run = simulate(half, SOFT, None, np.array([0, 0.01]), EngineConfig(dx_m=0.01, **FREE), effects=[LAW])
        assert (run.final.memory["cohesion.partner"] <= 0).all()
        np.testing.assert_allclose(run.positions[-1], run.positions[0], atol=1e-6)


@pytest.mark.parametrize("opening_m", [0.0005, 0.004])
def test_a_strong_bond_is_stable_at_its_time_step(opening_m):
    law = Cohesion(traction_pa=5e3, opening_m=opening_m)
    grips = pull(law, lambda t: 0.002 * smooth(t / 0.1), 0.15)
    force = np.array([f for _, f in grips.log])
    assert np.abs(force).max() < 2 and np.ptp(force[-50:]) < 0.2 * np.abs(force).max() + 0.02


def test_a_diagnosis_tries_it_at_few_settings():
    kinds = [c for c in candidates_of(library()) if c.effect == "cohesion"]
    assert len(kinds) == len(Cohesion.variants) <= 3 and {c.kind for c in kinds} == {"physics"}
    assert [c.columns[0].value for c in kinds] == [Cohesion.amplitudes[0].typical] * len(kinds)
