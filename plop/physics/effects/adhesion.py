"""Adhesion: the tool is sticky and holds material in contact until the bond has decayed."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
import math

import numpy as np
from numba import njit

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.tool_contact import tool_gap
from plop.physics.engine.material import Material

_ZERO = np.float32(0)
_ONE = np.float32(1)
_TWO = np.float32(2)
_TINY = np.float32(1e-12)
_FADED = np.float32(0.01)
"""A bond weaker than this is broken [-]."""
_TOUCHING = 0.05
"""Largest gap that counts as contact [cells]."""
_SLIP_M = 2e-4
"""Displacement at which a bond reaches its full traction [m]."""


@njit(fastmath=True)
def drag_along(slip, p, x, y, z, most):
    """Add a displacement (x, y, z) to row p of slip [N, 3] and limit the sum to the length `most` [m]."""
    x, y, z = slip[p, 0] + x, slip[p, 1] + y, slip[p, 2] + z
    shorten = min(_ONE, most / max(math.sqrt(x * x + y * y + z * z), _TINY))
    slip[p, 0], slip[p, 1], slip[p, 2] = shorten * x, shorten * y, shorten * z


@kernel()
def stick(
    x,
    v,
    mass,
    volume,
    radius,
    side,
    cut,
    kind,
    pose,
    faces,
    thickness,
    dt,
    traction,
    keep,
    touching,
    slip_m,
    bond,
    slip,
):
    """Update bonds, and pull the particles back along their displacement relative to the tool.

    Takes:
        x, v, mass, volume, radius, side, cut: The engine's; v is changed.
        kind, pose, faces, thickness: Tool, see `ToolShape` and `kernel_poses`.
        dt, traction, keep: Step [s]; full traction [Pa]; remaining share of an open bond after the step [-].
        touching, slip_m: Largest gap of a contact [m]; displacement at full traction [m].
        bond, slip: Updated: strength of the bond in [0, 1] [N], displacement relative to the tool [N, 3] [m].

    Returns:
        Impulse on the object [3] [N s].
    """
    total = np.zeros(3, np.float32)
    spacing = volume.max() ** np.float32(1 / 3)
    for p in range(x.shape[0]):
        rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
        d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
        y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
        z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
        reach = radius[p] + touching
        if tool_gap(kind, faces, thickness, d, y, z, side[p], cut[p], reach)[0] <= reach:
            bond[p] = _ONE
        else:
            bond[p] *= keep
        if bond[p] < _FADED:
            bond[p], slip[p, 0], slip[p, 1], slip[p, 2] = _ZERO, _ZERO, _ZERO, _ZERO
            continue
        ux = pose[4, 0] + pose[5, 1] * rz - pose[5, 2] * ry
        uy = pose[4, 1] + pose[5, 2] * rx - pose[5, 0] * rz
        uz = pose[4, 2] + pose[5, 0] * ry - pose[5, 1] * rx
        drag_along(slip, p, dt * (v[p, 0] - ux), dt * (v[p, 1] - uy), dt * (v[p, 2] - uz), slip_m)
        # a particle on the surface of a lattice represents half a cell below its area, others a whole one
        area = volume[p] / spacing * (_TWO if radius[p] == _ZERO else _ONE)
        push = -dt * traction * bond[p] * area / slip_m
        for k in range(3):
            v[p, k] += push * slip[p, k] / mass[p]
            total[k] += push * slip[p, k]
    return total


class Adhesion(Effect):
    """A bond between tool and particle with a traction that resists separation and sliding equally.

    A bond forms where the gap closes. It has its full traction once the particle has moved 0.2 mm
    relative to the tool, in any direction, and then slips. When the gap opens it decays as
    exp(-t / release). The area of a particle is its volume over the spacing.
    """

    name = "adhesion"
    help = "the tool is sticky and releases the material late"
    law = "t = -traction b s / 0.2 mm, s' = v - v_tool with |s| <= 0.2 mm, b = 1 in contact, else b' = -b / release"
    source = "constant traction: Dugdale 1960, Maugis 1992; slip: Dahl 1968; rate: Creton & Ciccotti 2016"
    acts_at_rest = False
    amplitudes = (
        Parameter("traction_pa", "Pa", 0.0, 1e5, step=20.0, typical=300.0, help="traction of an intact bond"),
    )
    shapes = (Parameter("release_s", "s", 0.001, 10.0, step=0.0, default=0.1, help="decay time of an open bond"),)
    variants = tuple({"release_s": release} for release in (0.03, 0.1, 0.3))
    remembers = {"bond": ((), 0.0), "slip": ((3,), 0.0)}

    def before(self, body: Body, dt: float) -> None:
        """Pull."""
        if body.tool_now[0] == 0:
            return
        moved = (body.x, body.v, body.mass, body.volume, body.radius, body.side, body.cut)
        law = (dt, self["traction_pa"], np.exp(-dt / self["release_s"]), _TOUCHING * body.config.dx_m, _SLIP_M)
        bonds = (body.memory["adhesion.bond"], body.memory["adhesion.slip"])
        body.impulse[1] += stick(*moved, *body.tool_now, *map(np.float32, law), *bonds)

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Bonds are springs on the outermost particles, a quarter of a cell thick."""
        spring = self["traction_pa"] / _SLIP_M / (material.density_kg_m3 * config.dx_m / 4)
        return float(0.5 / np.sqrt(spring)) if spring > 0 else np.inf
