"""Move mass, momentum and velocity between particles and grid (MLS-MPM, Hu et al. 2018).

Quadratic B-splines over 3x3x3 nodes. Every node holds two fields, one for each side of the cut;
a particle talks only to the field of its own side. Grid layout, for a grid of nx * ny * nz nodes at
`origin + index * dx`:

    chunk_grid [chunks, nodes, 8] float32   mass [kg] and momentum [kg m/s] of field 0, then of field 1
    chunk_passed [chunks, nodes] float32     mass that a blade has passed [kg]
    velocity [nodes, 2, 4] float32          velocity of both fields [m/s] and 1 where material moves so, else four zeros

The four numbers of a field at a node are one register (`plop.compute.numba_lanes`).

Threads never write to the same memory: particles are sorted along x and cut into chunks, each chunk has
its own grid of which it touches only a few planes, and the planes are added up in chunk order. The result
does not depend on the number of threads.
"""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np
from numba import njit, prange

from plop.compute.numba_lanes import lane, load4, pack4, spread4, store
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.elastic import determinant, kirchhoff_stress

_HALF = np.float32(0.5)
_ONE = np.float32(1)
_THREE_QUARTERS = np.float32(0.75)
_THREE_HALVES = np.float32(1.5)
_FOUR = np.float32(4)
_TWO = np.float32(2)
_ZERO = np.float32(0)
_THIRD = np.float32(1 / 3)
WIDE = 8
"""Numbers at a node."""


@njit(fastmath=True, forceinline=True)
def spline(offset):
    """Quadratic B-spline weights of the three nodes around a particle; offset in [0.5, 1.5] cells."""
    low, mid, high = _THREE_HALVES - offset, offset - _ONE, offset - _HALF
    return _HALF * low * low, _THREE_QUARTERS - mid * mid, _HALF * high * high


@njit(fastmath=True, forceinline=True)
def row_major(f, p):
    """The nine numbers of matrix p of an array [N, 3, 3]."""
    return f[p, 0, 0], f[p, 0, 1], f[p, 0, 2], f[p, 1, 0], f[p, 1, 1], f[p, 1, 2], f[p, 2, 0], f[p, 2, 1], f[p, 2, 2]


@njit(fastmath=True, forceinline=True)
def base_node(x, p, origin, inv_dx):
    """The lowest of a particle's 3x3x3 nodes and the particle's place beyond it, in cells, in [0.5, 1.5]."""
    gx, gy, gz = (x[p, 0] - origin[0]) * inv_dx, (x[p, 1] - origin[1]) * inv_dx, (x[p, 2] - origin[2]) * inv_dx
    bx, by, bz = int(gx - _HALF), int(gy - _HALF), int(gz - _HALF)
    return bx, by, bz, gx - np.float32(bx), gy - np.float32(by), gz - np.float32(bz)


@njit(fastmath=True, forceinline=True)
def gather(velocity, start, plane, row, fx, fy, fz):
    """Sum a field's four numbers over 3x3x3 nodes, plain and times the way from the particle in cells.

    Takes:
        velocity, start: Grid [nodes, 2, 4] and where the field of the lowest node begins in it.
        plane, row: Nodes from one to the next along x and y.
        fx, fy, fz: See `base_node`.

    Returns:
        Sums, and sums times the way along x, y and z: registers of velocity [m/s] and share of nodes with material.
    """
    wx, wy = spline(fx), spline(fy)
    z0, z1, z2 = spline(fz)
    w0, w1, w2 = spread4(z0), spread4(z1), spread4(z2)
    h0, h1, h2 = spread4(-z0 * fz), spread4(z1 * (_ONE - fz)), spread4(z2 * (_TWO - fz))
    total = along_x = along_y = along_z = spread4(_ZERO)
    for i in range(3):
        sums = sums_y = sums_z = spread4(_ZERO)
        for j in range(3):
            node = start + WIDE * (i * plane + j * row)
            a, b, c = load4(velocity, node), load4(velocity, node + WIDE), load4(velocity, node + 2 * WIDE)
            column = spread4(wy[j]) * (w0 * a + w1 * b + w2 * c)
            sums += column
            sums_y += spread4(np.float32(j) - fy) * column
            sums_z += spread4(wy[j]) * (h0 * a + h1 * b + h2 * c)
        weight = spread4(wx[i])
        total += weight * sums
        along_x += spread4(wx[i] * (np.float32(i) - fx)) * sums
        along_y += weight * sums_y
        along_z += weight * sums_z
    return total, along_x, along_y, along_z


@njit(fastmath=True, forceinline=True)
def move(x, v, c, f, p, dt, inv_dx, total, along_x, along_y, along_z):
    """Move particle p with what it gathered, see `gather`; return its velocity [m/s]."""
    scale = spread4(_FOUR * inv_dx)
    vx, vy, vz = lane(total, 0), lane(total, 1), lane(total, 2)
    along_x, along_y, along_z = scale * along_x, scale * along_y, scale * along_z
    b00, b10, b20 = lane(along_x, 0), lane(along_x, 1), lane(along_x, 2)
    b01, b11, b21 = lane(along_y, 0), lane(along_y, 1), lane(along_y, 2)
    b02, b12, b22 = lane(along_z, 0), lane(along_z, 1), lane(along_z, 2)
    v[p, 0], v[p, 1], v[p, 2] = vx, vy, vz
    x[p, 0] += dt * vx
    x[p, 1] += dt * vy
    x[p, 2] += dt * vz
    c[p, 0, 0], c[p, 0, 1], c[p, 0, 2] = b00, b01, b02
    c[p, 1, 0], c[p, 1, 1], c[p, 1, 2] = b10, b11, b12
    c[p, 2, 0], c[p, 2, 1], c[p, 2, 2] = b20, b21, b22
    for k in range(3):
        f0, f1, f2 = f[p, 0, k], f[p, 1, k], f[p, 2, k]
        f[p, 0, k] = f0 + dt * (b00 * f0 + b01 * f1 + b02 * f2)
        f[p, 1, k] = f1 + dt * (b10 * f0 + b11 * f1 + b12 * f2)
        f[p, 2, k] = f2 + dt * (b20 * f0 + b21 * f1 + b22 * f2)
    return vx, vy, vz


@kernel(parallel=True)
def stress_p2g(
    x,
    v,
    c,
    f,
    mass,
    volume,
    side,
    cut,
    bounds,
    planes,
    origin,
    dims,
    inv_dx,
    dt,
    decay,
    law,
    mu,
    lam,
    eta,
    extra,
    chunk_grid,
    chunk_passed,
):
    """Scatter mass and momentum, the stress' impulse included.

    Takes:
        x, v, c, f: Position [N, 3] [m], velocity [N, 3] [m/s], affine velocity [N, 3, 3] [1/s] and
            deformation gradient [N, 3, 3].
        mass, volume: [N] [kg], rest volume [N] [m^3].
        side, cut: Field of each particle [N] (0 or 1) and whether a blade has passed it [N].
        bounds, planes: First particle of each chunk [chunks + 1]; x planes it may touch [chunks, 2].
        origin, dims, inv_dx, dt: Position of node 0 [3] [m], nodes per axis [3], 1/dx [1/m], step [s].
        decay: Factor on the velocities, for damping [-].
        law, mu, lam, eta: Elastic law, Lame parameters [Pa] and shear viscosity [Pa s].
        extra: Kirchhoff stress that effects add [N, 6] (xx, yy, zz, xy, xz, yz) [Pa], or [0, 6] for none.
        chunk_grid, chunk_passed: Written; see the module's layout.
    """
    dx = _ONE / inv_dx
    plane, row = dims[1] * dims[2], dims[2]
    for chunk in prange(bounds.shape[0] - 1):
        grid, passed = chunk_grid[chunk], chunk_passed[chunk]
        for node in range(planes[chunk, 0] * plane, planes[chunk, 1] * plane):
            passed[node] = _ZERO
            for q in range(8):
                grid[node, q] = _ZERO
        for p in range(bounds[chunk], bounds[chunk + 1]):
            bx, by, bz, fx, fy, fz = base_node(x, p, origin, inv_dx)
            wx, wy = spline(fx), spline(fy)
            wz0, wz1, wz2 = spline(fz)
            xx, yy, zz, xy, xz, yz = kirchhoff_stress(law, *row_major(f, p), mu, lam)
            if eta > _ZERO:
                rate = (c[p, 0, 0] + c[p, 1, 1] + c[p, 2, 2]) * _THIRD
                xx += (eta + eta) * (c[p, 0, 0] - rate)
                yy += (eta + eta) * (c[p, 1, 1] - rate)
                zz += (eta + eta) * (c[p, 2, 2] - rate)
                xy += eta * (c[p, 0, 1] + c[p, 1, 0])
                xz += eta * (c[p, 0, 2] + c[p, 2, 0])
                yz += eta * (c[p, 1, 2] + c[p, 2, 1])
            if extra.shape[0] > 0:
                xx += extra[p, 0]
                yy += extra[p, 1]
                zz += extra[p, 2]
                xy += extra[p, 3]
                xz += extra[p, 4]
                yz += extra[p, 5]
            m = mass[p]
            md = m * decay
            k = -dt * volume[p] * _FOUR * inv_dx * inv_dx
            # mass and momentum at the lowest node, and how much more there is one cell further along each axis
            step_x = pack4(
                (
                    _ZERO,
                    dx * (md * c[p, 0, 0] + k * xx),
                    dx * (md * c[p, 1, 0] + k * xy),
                    dx * (md * c[p, 2, 0] + k * xz),
                )
            )
            step_y = pack4(
                (
                    _ZERO,
                    dx * (md * c[p, 0, 1] + k * xy),
                    dx * (md * c[p, 1, 1] + k * yy),
                    dx * (md * c[p, 2, 1] + k * yz),
                )
            )
            step_z = pack4(
                (
                    _ZERO,
                    dx * (md * c[p, 0, 2] + k * xz),
                    dx * (md * c[p, 1, 2] + k * yz),
                    dx * (md * c[p, 2, 2] + k * zz),
                )
            )
            lowest = pack4((m, md * v[p, 0], md * v[p, 1], md * v[p, 2]))
            lowest = lowest - spread4(fx) * step_x - spread4(fy) * step_y - spread4(fz) * step_z
            start = WIDE * (bx * plane + by * row + bz) + 4 * side[p]
            z0, z1, z2 = spread4(wz0), spread4(wz1), spread4(wz2)
            for i in range(3):
                for j in range(3):
                    node = start + WIDE * (i * plane + j * row)
                    share = lowest + spread4(np.float32(i)) * step_x + spread4(np.float32(j)) * step_y
                    weight = spread4(wx[i] * wy[j])
                    store(grid, node, load4(grid, node) + weight * z0 * share)
                    share += step_z
                    store(grid, node + WIDE, load4(grid, node + WIDE) + weight * z1 * share)
                    share += step_z
                    store(grid, node + 2 * WIDE, load4(grid, node + 2 * WIDE) + weight * z2 * share)
            if cut[p]:
                for i in range(3):
                    for j in range(3):
                        node = (bx + i) * plane + (by + j) * row + bz
                        w = wx[i] * wy[j] * m
                        passed[node] += w * wz0
                        passed[node + 1] += w * wz1
                        passed[node + 2] += w * wz2


@kernel(parallel=True)
def add_chunks(chunk_grid, chunk_passed, planes, dims, grid, passed):
    """Add the chunks' grids up, plane by plane and always in the same order.

    Takes:
        chunk_grid, chunk_passed, planes, dims: See `stress_p2g`.
        grid, passed: Written: [nodes, 8] and [nodes].
    """
    size = dims[1] * dims[2]
    for plane in prange(dims[0]):
        low, high = plane * size, (plane + 1) * size
        passed[low:high] = _ZERO
        grid[low:high] = _ZERO
        for chunk in range(planes.shape[0]):
            if planes[chunk, 0] <= plane < planes[chunk, 1]:
                first = chunk * WIDE * grid.shape[0]
                for node in range(low, high):
                    passed[node] += chunk_passed[chunk, node]
                for place in range(WIDE * low, WIDE * high, 4):
                    store(grid, place, load4(grid, place) + load4(chunk_grid, first + place))


@kernel(parallel=True)
def g2p(x, v, c, f, side, bounds, origin, dims, inv_dx, dt, velocity, report):
    """Gather velocities, move the particles, update their deformation gradient.

    Takes:
        x, v, c, f, side, bounds, origin, dims, inv_dx, dt: As in `stress_p2g`; the first four are updated.
        velocity: Grid velocity [nodes, 2, 4] [m/s].
        report: Written, [chunks, 2]: highest squared speed [m^2/s^2] and smallest volume ratio J.
    """
    plane, row = dims[1] * dims[2], dims[2]
    for chunk in prange(bounds.shape[0] - 1):
        fastest, smallest = _ZERO, _ONE
        for p in range(bounds[chunk], bounds[chunk + 1]):
            bx, by, bz, fx, fy, fz = base_node(x, p, origin, inv_dx)
            start = WIDE * (bx * plane + by * row + bz) + 4 * side[p]
            sums = gather(velocity, start, plane, row, fx, fy, fz)
            vx, vy, vz = move(x, v, c, f, p, dt, inv_dx, *sums)
            smallest = min(smallest, determinant(*row_major(f, p)))
            fastest = max(fastest, vx * vx + vy * vy + vz * vz)
        report[chunk, 0] = fastest
        report[chunk, 1] = smallest
