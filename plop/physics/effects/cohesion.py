"""Cohesion: behind the edge the faces of a cut stick together until they are pulled apart (a cohesive zone)."""

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
from plop.physics.engine.kernels.tool_contact import STIFFNESS, in_outline, tool_gap
from plop.physics.engine.material import Material
from plop.physics.engine.tool_motion import ToolKind

_ZERO = np.float32(0)
_ONE = np.float32(1)
_TWO = np.float32(2)
_HALF = np.float32(0.5)
_TINY = np.float32(1e-12)
_RISE = 0.2
"""Opening of the peak traction, as a share of the critical opening."""
_ALONE = np.float32(-1)
_BLADE = int(ToolKind.BLADE)


@kernel()
def join(x, side, cut, number, pose, faces, spacing, partner, share, rest, normal):
    """Bond particles at the faces of the cut to the opposite face as the blade passes them.

    The partner is the particle of the other side next to the mirror image in the blade's plane. Each particle is
    processed once, so that no bond is formed twice. The plane may have any position in the lattice;
    shares that fall linearly to 0 one spacing away sum, over the layers of both sides and times volume over spacing,
    to its area.

    Takes:
        x, side, cut, number: The engine's [N].
        pose, faces: Blade, see `kernel_poses` and `ToolShape`.
        spacing: Distance of the particles [m].
        partner: Updated: number of the partner plus 1, 0 where the blade has not been, -1 for none [N].
        share: Updated: share of the particle's cell that represents the cut, in [0, 1] [N].
        rest, normal: Updated: vector from the partner to the particle while the faces touch [N, 3] [m], and
            normal of the face towards the particle's own side [N, 3].
    """
    for p in range(x.shape[0]):
        if not cut[p] or partner[p] != _ZERO:
            continue
        partner[p] = _ALONE
        rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
        d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
        y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
        z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
        if abs(d) >= spacing or not in_outline(faces, y, z, _ZERO):
            continue
        mx, my, mz = x[p, 0] - _TWO * d * pose[1, 0], x[p, 1] - _TWO * d * pose[1, 1], x[p, 2] - _TWO * d * pose[1, 2]
        nearest, found = _TWO * spacing * spacing, -1
        for q in range(x.shape[0]):
            if side[q] == side[p]:
                continue
            away = (x[q, 0] - mx) ** 2 + (x[q, 1] - my) ** 2 + (x[q, 2] - mz) ** 2
            if away < nearest:
                nearest, found = away, q
        if found < 0:
            continue
        partner[p], share[p] = np.float32(number[found] + 1), _ONE - abs(d) / spacing
        sign = _ONE if side[p] == 0 else -_ONE
        for k in range(3):
            rest[p, k] = x[p, k] - x[found, k]
            normal[p, k] = sign * pose[1, k]


@kernel()
def wear_down(x, side, cut, radius, pose, faces, thickness, pressure_per_m, wear, partner, strength):
    """Damage bonds by the pressure of the blade's faces on them.

    Takes:
        x, side, cut, radius: The engine's [N].
        pose, faces, thickness: Blade, see `ToolShape` and `kernel_poses`.
        pressure_per_m: Pressure of the contact over its depth [Pa/m].
        wear: Strength lost in this step per pressure [1/Pa].
        partner, strength: See `join`; strength of the bond in [0, 1], updated [N].
    """
    for p in range(x.shape[0]):
        if partner[p] <= _ZERO:
            continue
        rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
        d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
        y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
        z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
        depth = radius[p] - tool_gap(_BLADE, faces, thickness, d, y, z, side[p], cut[p], radius[p])[0]
        strength[p] = max(_ZERO, strength[p] - wear * pressure_per_m * max(_ZERO, depth))


@njit(fastmath=True)
def carry_along(c, p, q, dt, rest, normal):
    """Turn and stretch row p of `rest` [N, 3] [m] as the material between p and q does; turn its `normal`."""
    l00, l01, l02 = c[p, 0, 0] + c[q, 0, 0], c[p, 0, 1] + c[q, 0, 1], c[p, 0, 2] + c[q, 0, 2]
    l10, l11, l12 = c[p, 1, 0] + c[q, 1, 0], c[p, 1, 1] + c[q, 1, 1], c[p, 1, 2] + c[q, 1, 2]
    l20, l21, l22 = c[p, 2, 0] + c[q, 2, 0], c[p, 2, 1] + c[q, 2, 1], c[p, 2, 2] + c[q, 2, 2]
    h = _HALF * dt
    x, y, z = rest[p, 0], rest[p, 1], rest[p, 2]
    rest[p, 0] = x + h * (l00 * x + l01 * y + l02 * z)
    rest[p, 1] = y + h * (l10 * x + l11 * y + l12 * z)
    rest[p, 2] = z + h * (l20 * x + l21 * y + l22 * z)
    h *= _HALF
    w01, w02, w12 = h * (l01 - l10), h * (l02 - l20), h * (l12 - l21)
    x, y, z = normal[p, 0], normal[p, 1], normal[p, 2]
    x, y, z = x + w01 * y + w02 * z, y - w01 * x + w12 * z, z - w02 * x - w12 * y
    length = max(math.sqrt(x * x + y * y + z * z), _TINY)
    normal[p, 0], normal[p, 1], normal[p, 2] = x / length, y / length, z / length


@kernel()
def hold_together(
    x,
    v,
    c,
    mass,
    volume,
    side,
    cut,
    index,
    dt,
    traction,
    critical,
    rise,
    spacing,
    partner,
    share,
    rest,
    normal,
    strength,
    peak,
):
    """Apply the traction between the faces; bonds beyond the critical opening are broken.

    The traction is that of the largest opening so far, in proportion to the opening when it is smaller (unloading
    towards the origin). Closing past contact is not resisted: this is done by the contact of the faces. Both
    particles of a bond get the same impulse.

    Takes:
        x, v, c, mass, volume, side, cut: The engine's; v is changed.
        index: Row of each particle by number, -1 for none [max number + 1].
        dt, traction, critical, rise: Step [s], peak [Pa], critical opening and that of the peak [m].
        spacing: Distance of the particles [m].
        partner, share, rest, normal, strength, peak: See `join` and `wear_down`, and the largest opening so far [m];
            updated.
    """
    for p in range(x.shape[0]):
        if partner[p] <= _ZERO:
            continue
        number = int(partner[p]) - 1
        q = index[number] if number < len(index) else -1
        if strength[p] <= _ZERO or q < 0 or side[q] == side[p]:  # broken by wear, or a state without the partner
            partner[p] = _ALONE
            continue
        carry_along(c, p, q, dt, rest, normal)
        if not cut[q]:  # the blade is between the two just now
            continue
        ox, oy, oz = x[p, 0] - x[q, 0] - rest[p, 0], x[p, 1] - x[q, 1] - rest[p, 1], x[p, 2] - x[q, 2] - rest[p, 2]
        closed = min(_ZERO, ox * normal[p, 0] + oy * normal[p, 1] + oz * normal[p, 2])
        ox, oy, oz = ox - closed * normal[p, 0], oy - closed * normal[p, 1], oz - closed * normal[p, 2]
        peak[p] = max(peak[p], math.sqrt(ox * ox + oy * oy + oz * oz))
        if peak[p] >= critical:
            partner[p] = _ALONE
            continue
        slope = _ONE / rise if peak[p] <= rise else (critical - peak[p]) / (critical - rise) / peak[p]
        pull = -dt * share[p] * volume[p] / spacing * strength[p] * traction * slope
        v[p, 0] += pull * ox / mass[p]
        v[p, 1] += pull * oy / mass[p]
        v[p, 2] += pull * oz / mass[p]
        v[q, 0] -= pull * ox / mass[q]
        v[q, 1] -= pull * oy / mass[q]
        v[q, 2] -= pull * oz / mass[q]


class Cohesion(Effect):
    """A cohesive zone behind the edge: uncut fibres, skin or a film between the faces.

    The traction grows to its peak within a fifth of the critical opening, then falls to 0 at it (bilinear);
    the area under it, traction x opening / 2, is the energy of separation [J/m^2]. Opening and sliding count equally.
    Bonds opened beyond the critical opening never heal. The blade's pressure p on the faces wears them away.
    A state that starts with a blade in it, without memory, is bonded across that blade as it is.
    """

    name = "cohesion"
    help = "behind the edge the faces of the cut still stick together"
    law = (
        "t = -b k(m) s, s: opening of the faces, m = max |s| so far, k m rising to traction at opening / 5, "
        "then falling to 0 at opening; b' = -wear p under the blade's pressure p, b = 1 before"
    )
    source = (
        "Barenblatt 1962; Dugdale 1960; Xu & Needleman 1994, J. Mech. Phys. Solids 42, 1397; bilinear: Geubelle & "
        "Baylor 1998; wear by the blade's force: Heiden et al. 2021, DiSECt"
    )
    acts_at_rest = False
    needs_blade = True
    amplitudes = (
        Parameter(
            "traction_pa",
            "Pa",
            0.0,
            1e5,
            step=50.0,
            typical=400.0,
            help="largest traction between the faces",
            tried=(1500.0,),
        ),
    )
    shapes = (
        Parameter("opening_m", "m", 1e-4, 0.05, step=0.0, default=0.004, help="opening at which the traction vanishes"),
        Parameter("wear", "1/(Pa s)", 0.0, 1e3, step=0.0, default=0.0, help="strength lost per pressure and time"),
    )
    variants = (
        {"opening_m": 0.001, "wear": 0.0},
        {"opening_m": 0.004, "wear": 0.0},
        {"opening_m": 0.004, "wear": 0.01},
    )
    remembers = {
        "partner": ((), 0.0),
        "share": ((), 0.0),
        "rest": ((3,), 0.0),
        "normal": ((3,), 0.0),
        "strength": ((), 1.0),
        "peak": ((), 0.0),
    }

    @property
    def energy_j_m2(self) -> float:
        """Energy of separation of a whole bond: the area under the traction [J/m^2]."""
        return self["traction_pa"] * self["opening_m"] / 2

    def before(self, body: Body, dt: float) -> None:
        """Bond particles that the blade has just passed, apply wear and traction."""
        partner, share, rest, normal, strength, peak = (body.memory[f"cohesion.{name}"] for name in self.remembers)
        kind, pose, faces, thickness = body.tool_now
        spacing = np.float32(np.cbrt(body.volume.max()))
        if kind == _BLADE:
            join(body.x, body.side, body.cut, body.number, pose, faces, spacing, partner, share, rest, normal)
            if self["wear"] > 0:
                modulus = body.material.lame_pa + 2 * body.material.shear_pa
                pressure_per_m = np.float32(STIFFNESS * modulus / body.config.dx_m)
                worn = (pressure_per_m, np.float32(dt * self["wear"]), partner, strength)
                wear_down(body.x, body.side, body.cut, body.radius, pose, faces, thickness, *worn)
        index = np.full(int(body.number.max()) + 1, -1)
        index[body.number] = np.arange(len(body.number))
        moved = (body.x, body.v, body.c, body.mass, body.volume, body.side, body.cut, index)
        law = (self["traction_pa"], self["opening_m"], _RISE * self["opening_m"])
        bonds = (partner, share, rest, normal, strength, peak)
        hold_together(*moved, np.float32(dt), *map(np.float32, law), spacing, *bonds)

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Bonds are springs between outermost particles, each a quarter of a cell thick."""
        spring = self["traction_pa"] / (_RISE * self["opening_m"]) / (material.density_kg_m3 * config.dx_m / 8)
        return float(0.5 / np.sqrt(spring)) if spring > 0 else np.inf
