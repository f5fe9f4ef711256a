"""What happens on the grid between scatter and gather: gravity, the faces of a cut, the table.

A node at the table must not move into it; the tangential velocity obeys Coulomb's law with the impulse that
the normal one needed. Each side of a cut has its own field of momentum: what compatible particle-in-cell
(Hu et al. 2018) does with skipped nodes and ghost velocities, written with two momentum-conserving fields.
Where most of a node's mass has not met the blade, both fields move as one: the material is whole. After the
blade has gone the fields stay apart and only push. The tool itself acts on the particles (`tool_contact`).
"""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from plop.compute.numba_lanes import spread4, store
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.tool_contact import coulomb

_ZERO = np.float32(0)
_HALF = np.float32(0.5)
_ONE = np.float32(1)
_TINY = np.float32(1e-12)
_CLOSED = np.float32(0.8)
"""A cut counts as closed at a node that holds this share of a full cell's mass or more."""
_TOUCHING = np.float32(0.01)
"""Gap up to which things touch [cells]."""


@njit(fastmath=True, forceinline=True)
def rubbed(speed, push, friction, slip):
    """Give the share of a sliding speed that is left after a push of the table [m/s].

    The coefficient is min(friction, speed / slip), with the speed afterwards, so that no step is too long for it.
    """
    return max(slip / max(slip + push, _TINY), _ONE - friction * push / max(speed, _TINY))


@njit(fastmath=True, forceinline=True)
def rub_table(vx, vy, vz, friction, slip, pyramid):
    """Keep a velocity above a level table; `pyramid` limits x and y each on its own, not their length."""
    if vz >= _ZERO:
        return vx, vy, vz
    if pyramid:
        return vx * rubbed(abs(vx), -vz, friction, slip), vy * rubbed(abs(vy), -vz, friction, slip), _ZERO
    left = rubbed(math.sqrt(vx * vx + vy * vy), -vz, friction, slip)
    return vx * left, vy * left, _ZERO


@njit(fastmath=True, forceinline=True)
def cut_normal(grid, node, plane, row):
    """Unit normal of the cut at a node, from field 1 to field 0: the gradient of their mass difference."""
    gx = (grid[node + plane, 0] - grid[node + plane, 4]) - (grid[node - plane, 0] - grid[node - plane, 4])
    gy = (grid[node + row, 0] - grid[node + row, 4]) - (grid[node - row, 0] - grid[node - row, 4])
    gz = (grid[node + 1, 0] - grid[node + 1, 4]) - (grid[node - 1, 0] - grid[node - 1, 4])
    length = max(math.sqrt(gx * gx + gy * gy + gz * gz), _TINY)
    return gx / length, gy / length, gz / length


@njit(fastmath=True, forceinline=True)
def field_velocities(grid, node, plane, row, bonded, full, friction):
    """Give the velocities of both fields at a node after they acted on each other; momentum is kept.

    Returns:
        Velocity of field 0, then of field 1, six scalars [m/s]; 0 for an empty field.
    """
    m0, m1 = grid[node, 0], grid[node, 4]
    m = m0 + m1
    cx, cy = (grid[node, 1] + grid[node, 5]) / m, (grid[node, 2] + grid[node, 6]) / m
    cz = (grid[node, 3] + grid[node, 7]) / m
    if bonded:
        return cx, cy, cz, cx, cy, cz
    ax, ay, az, bx, by, bz = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    if m0 > _TINY:
        ax, ay, az = grid[node, 1] / m0, grid[node, 2] / m0, grid[node, 3] / m0
    if m1 > _TINY:
        bx, by, bz = grid[node, 5] / m1, grid[node, 6] / m1, grid[node, 7] / m1
    if m0 > _TINY and m1 > _TINY and m > _CLOSED * full:
        nx, ny, nz = cut_normal(grid, node, plane, row)
        ax, ay, az = coulomb(ax, ay, az, cx, cy, cz, nx, ny, nz, friction)
        ratio = m0 / m1
        bx, by, bz = cx - ratio * (ax - cx), cy - ratio * (ay - cy), cz - ratio * (az - cz)
    return ax, ay, az, bx, by, bz


@kernel(parallel=True)
def grid_velocities(
    grid, passed, origin, dims, dx, dt, gravity, table, pyramid, friction, density, gaps, velocity, impulses
):
    """Turn momentum into velocity.

    Takes:
        grid, passed: Mass and momentum of both fields [nodes, 8] and mass that a blade has passed [nodes].
        origin, dims, dx, dt: Grid [m] and step [s].
        gravity: Acceleration [3] [m/s^2].
        table, pyramid: Height of the table [m], -inf when there is none; whether its friction cone is square.
        friction: Coulomb coefficients of table, tool and cut [-], and the table's slip speed [m/s], [4].
        density: Rest density [kg/m^3].
        gaps: See `table_gaps`.
        velocity: Written, [nodes, 2, 4]: see the layout in `transfer`.
        impulses: Written, [planes, 3]: impulse on the object from the table [N s].
    """
    row, plane = dims[2], dims[1] * dims[2]
    full, nothing = density * dx * dx * dx, spread4(_ZERO)
    for ix in prange(dims[0]):
        for q in range(3):
            impulses[ix, q] = _ZERO
        for iy in range(dims[1]):
            for iz in range(dims[2]):
                node = ix * plane + iy * row + iz
                m = grid[node, 0] + grid[node, 4]
                store(velocity, 8 * node, nothing)
                store(velocity, 8 * node + 4, nothing)
                if m <= _TINY:
                    continue
                pz = np.float32(iz) * dx + origin[2]
                bonded = passed[node] <= _HALF * m
                ax, ay, az, bx, by, bz = field_velocities(grid, node, plane, row, bonded, full, friction[2])
                for side in range(2):
                    mass = grid[node, 4 * side]
                    if not (bonded or mass > _TINY):
                        continue
                    vx, vy, vz = (ax, ay, az) if side == 0 else (bx, by, bz)
                    vx += dt * gravity[0]
                    vy += dt * gravity[1]
                    vz += dt * gravity[2]
                    if pz <= table and gaps[node] <= _TOUCHING * dx:
                        ux, uy, uz = vx, vy, vz
                        vx, vy, vz = rub_table(vx, vy, vz, friction[0], friction[3], pyramid)
                        impulses[ix, 0] += mass * (vx - ux)
                        impulses[ix, 1] += mass * (vy - uy)
                        impulses[ix, 2] += mass * (vz - uz)
                    velocity[node, side, 0], velocity[node, side, 1], velocity[node, side, 2] = vx, vy, vz
                    velocity[node, side, 3] = _ONE
