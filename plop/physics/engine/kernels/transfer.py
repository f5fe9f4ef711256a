"""Move mass, momentum and velocity between particles and grid (MLS-MPM, Hu et al. 2018).

Quadratic B-splines over 3x3x3 nodes. Every node holds two fields, one for each side of the cut;
a particle talks only to the field of its own side. Grid layout, for a grid of nx * ny * nz nodes at
`origin + index * dx`:

    chunk_grid [chunks, nodes, 8] float32   mass [kg] and momentum [kg m/s] of field 0, then of field 1
    chunk_uncut [chunks, nodes] float32     mass that no blade has passed [kg]
    velocity [nodes, 2, 4] float32          velocity of both fields [m/s], and 1 where material moves so, else 0

Threads never write to the same memory: particles are sorted along x and cut into chunks, each chunk has
its own grid of which it touches only a few planes, and the planes are added up in chunk order. The result
does not depend on the number of threads.
"""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np
from numba import njit, prange

from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.elastic import determinant, kirchhoff_stress

_HALF = np.float32(0.5)
_ONE = np.float32(1)
_THREE_QUARTERS = np.float32(0.75)
_THREE_HALVES = np.float32(1.5)
_FOUR = np.float32(4)
_ZERO = np.float32(0)
_THIRD = np.float32(1 / 3)


@njit(fastmath=True)
def spline(offset):
    """Quadratic B-spline weights of the three nodes around a particle; offset in [0.5, 1.5] cells."""
    low, mid, high = _THREE_HALVES - offset, offset - _ONE, offset - _HALF
    return _HALF * low * low, _THREE_QUARTERS - mid * mid, _HALF * high * high


@njit(fastmath=True)
def row_major(f, p):
    """The nine numbers of matrix p of an array [N, 3, 3]."""
    return f[p, 0, 0], f[p, 0, 1], f[p, 0, 2], f[p, 1, 0], f[p, 1, 1], f[p, 1, 2], f[p, 2, 0], f[p, 2, 1], f[p, 2, 2]


@njit(fastmath=True)
def base_node(x, p, origin, inv_dx):
    """The lowest of a particle's 3x3x3 nodes and the particle's place beyond it, in cells, in [0.5, 1.5]."""
    gx, gy, gz = (x[p, 0] - origin[0]) * inv_dx, (x[p, 1] - origin[1]) * inv_dx, (x[p, 2] - origin[2]) * inv_dx
    bx, by, bz = int(gx - _HALF), int(gy - _HALF), int(gz - _HALF)
    return bx, by, bz, gx - np.float32(bx), gy - np.float32(by), gz - np.float32(bz)


@njit(fastmath=True)
def gather(velocity, q, corner, plane, row, fx, fy, fz):
    """Sum the velocities of field q over 3x3x3 nodes from `corner` on, plain and times the way in cells [m/s].

    Returns:
        vx, vy, vz, then the nine sums b of velocity times way, row by row.
    """
    wx, wy = spline(fx), spline(fy)
    wz0, wz1, wz2 = spline(fz)
    vx, vy, vz = _ZERO, _ZERO, _ZERO
    b00, b01, b02, b10, b11, b12 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    b20, b21, b22 = _ZERO, _ZERO, _ZERO
    for i in range(3):
        for j in range(3):
            di, dj = np.float32(i) - fx, np.float32(j) - fy
            node = corner + i * plane + j * row
            wij = wx[i] * wy[j]
            w0, w1, w2 = wij * wz0, wij * wz1, wij * wz2
            # sums over the column of three nodes: first plain, then weighted with the height
            h0, h1, h2 = -w0 * fz, w1 * (_ONE - fz), w2 * (_ONE + _ONE - fz)
            x0, x1, x2 = velocity[node, q, 0], velocity[node + 1, q, 0], velocity[node + 2, q, 0]
            y0, y1, y2 = velocity[node, q, 1], velocity[node + 1, q, 1], velocity[node + 2, q, 1]
            z0, z1, z2 = velocity[node, q, 2], velocity[node + 1, q, 2], velocity[node + 2, q, 2]
            sx, sy, sz = w0 * x0 + w1 * x1 + w2 * x2, w0 * y0 + w1 * y1 + w2 * y2, w0 * z0 + w1 * z1 + w2 * z2
            vx += sx
            vy += sy
            vz += sz
            b00 += sx * di
            b01 += sx * dj
            b02 += h0 * x0 + h1 * x1 + h2 * x2
            b10 += sy * di
            b11 += sy * dj
            b12 += h0 * y0 + h1 * y1 + h2 * y2
            b20 += sz * di
            b21 += sz * dj
            b22 += h0 * z0 + h1 * z1 + h2 * z2
    return vx, vy, vz, b00, b01, b02, b10, b11, b12, b20, b21, b22


@njit(fastmath=True)
def move(x, v, c, f, p, dt, inv_dx, vx, vy, vz, b00, b01, b02, b10, b11, b12, b20, b21, b22):
    """Move particle p with what it gathered: velocity [m/s] and the sums of velocity times way in cells [m/s]."""
    s = _FOUR * inv_dx
    b00, b01, b02, b10, b11, b12 = s * b00, s * b01, s * b02, s * b10, s * b11, s * b12
    b20, b21, b22 = s * b20, s * b21, s * b22
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
    chunk_uncut,
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
        chunk_grid, chunk_uncut: Written; see the module's layout.
    """
    dx = _ONE / inv_dx
    plane, row = dims[1] * dims[2], dims[2]
    for chunk in prange(bounds.shape[0] - 1):
        grid, uncut = chunk_grid[chunk], chunk_uncut[chunk]
        for node in range(planes[chunk, 0] * plane, planes[chunk, 1] * plane):
            uncut[node] = _ZERO
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
            a00, a01, a02 = (
                dx * (md * c[p, 0, 0] + k * xx),
                dx * (md * c[p, 0, 1] + k * xy),
                dx * (md * c[p, 0, 2] + k * xz),
            )
            a10, a11, a12 = (
                dx * (md * c[p, 1, 0] + k * xy),
                dx * (md * c[p, 1, 1] + k * yy),
                dx * (md * c[p, 1, 2] + k * yz),
            )
            a20, a21, a22 = (
                dx * (md * c[p, 2, 0] + k * xz),
                dx * (md * c[p, 2, 1] + k * yz),
                dx * (md * c[p, 2, 2] + k * zz),
            )
            mx = md * v[p, 0] - a00 * fx - a01 * fy - a02 * fz
            my = md * v[p, 1] - a10 * fx - a11 * fy - a12 * fz
            mz = md * v[p, 2] - a20 * fx - a21 * fy - a22 * fz
            q = 4 * side[p]
            whole = not cut[p]
            for i in range(3):
                for j in range(3):
                    fi, fj = np.float32(i), np.float32(j)
                    node = (bx + i) * plane + (by + j) * row + bz
                    wij = wx[i] * wy[j]
                    px, py, pz = mx + a00 * fi + a01 * fj, my + a10 * fi + a11 * fj, mz + a20 * fi + a21 * fj
                    w = wij * wz0
                    grid[node, q] += w * m
                    grid[node, q + 1] += w * px
                    grid[node, q + 2] += w * py
                    grid[node, q + 3] += w * pz
                    w = wij * wz1
                    grid[node + 1, q] += w * m
                    grid[node + 1, q + 1] += w * (px + a02)
                    grid[node + 1, q + 2] += w * (py + a12)
                    grid[node + 1, q + 3] += w * (pz + a22)
                    w = wij * wz2
                    grid[node + 2, q] += w * m
                    grid[node + 2, q + 1] += w * (px + a02 + a02)
                    grid[node + 2, q + 2] += w * (py + a12 + a12)
                    grid[node + 2, q + 3] += w * (pz + a22 + a22)
                    if whole:
                        w = wij * m
                        uncut[node] += w * wz0
                        uncut[node + 1] += w * wz1
                        uncut[node + 2] += w * wz2


@kernel(parallel=True)
def add_chunks(chunk_grid, chunk_uncut, planes, dims, grid, uncut):
    """Add the chunks' grids up, plane by plane and always in the same order.

    Takes:
        chunk_grid, chunk_uncut, planes, dims: See `stress_p2g`.
        grid, uncut: Written: [nodes, 8] and [nodes].
    """
    size = dims[1] * dims[2]
    for plane in prange(dims[0]):
        low, high = plane * size, (plane + 1) * size
        for node in range(low, high):
            uncut[node] = _ZERO
            for q in range(8):
                grid[node, q] = _ZERO
        for chunk in range(planes.shape[0]):
            if planes[chunk, 0] <= plane < planes[chunk, 1]:
                for node in range(low, high):
                    uncut[node] += chunk_uncut[chunk, node]
                    for q in range(8):
                        grid[node, q] += chunk_grid[chunk, node, q]


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
            sums = gather(velocity, side[p], bx * plane + by * row + bz, plane, row, fx, fy, fz)
            move(x, v, c, f, p, dt, inv_dx, *sums)
            vx, vy, vz = sums[0], sums[1], sums[2]
            smallest = min(smallest, determinant(*row_major(f, p)))
            fastest = max(fastest, vx * vx + vy * vy + vz * vz)
        report[chunk, 0] = fastest
        report[chunk, 1] = smallest


@njit(fastmath=True)
def gather_filled(velocity, v, c, p, q, corner, plane, row, fx, fy, fz, dx):
    """`gather` for tracer p, whose own motion of the step before stands in where there is no material."""
    wx, wy, wz = spline(fx), spline(fy), spline(fz)
    vx, vy, vz = _ZERO, _ZERO, _ZERO
    b00, b01, b02, b10, b11, b12 = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
    b20, b21, b22 = _ZERO, _ZERO, _ZERO
    for i in range(3):
        for j in range(3):
            for k in range(3):
                di, dj, dk = np.float32(i) - fx, np.float32(j) - fy, np.float32(k) - fz
                node = corner + i * plane + j * row + k
                w = wx[i] * wy[j] * wz[k]
                if velocity[node, q, 3] != _ZERO:
                    ux, uy, uz = w * velocity[node, q, 0], w * velocity[node, q, 1], w * velocity[node, q, 2]
                else:
                    ux = w * (v[p, 0] + dx * (c[p, 0, 0] * di + c[p, 0, 1] * dj + c[p, 0, 2] * dk))
                    uy = w * (v[p, 1] + dx * (c[p, 1, 0] * di + c[p, 1, 1] * dj + c[p, 1, 2] * dk))
                    uz = w * (v[p, 2] + dx * (c[p, 2, 0] * di + c[p, 2, 1] * dj + c[p, 2, 2] * dk))
                vx += ux
                vy += uy
                vz += uz
                b00 += ux * di
                b01 += ux * dj
                b02 += ux * dk
                b10 += uy * di
                b11 += uy * dj
                b12 += uy * dk
                b20 += uz * di
                b21 += uz * dj
                b22 += uz * dk
    return vx, vy, vz, b00, b01, b02, b10, b11, b12, b20, b21, b22


@kernel(parallel=True)
def carry(x, v, c, f, side, bounds, origin, dims, inv_dx, dt, velocity, report):
    """Move tracers with the material around them: `g2p` for particles that have not scattered themselves.

    A node that holds no material of the tracer's side moves as the tracer did in the step before, as if
    the tracer's were the only mass there.

    Takes:
        x, v, c, f, side, bounds, origin, dims, inv_dx, dt, velocity: As in `g2p`.
        report: Written, [chunks]: highest squared speed [m^2/s^2].
    """
    plane, row = dims[1] * dims[2], dims[2]
    dx = _ONE / inv_dx
    for chunk in prange(bounds.shape[0] - 1):
        fastest = _ZERO
        for p in range(bounds[chunk], bounds[chunk + 1]):
            bx, by, bz, fx, fy, fz = base_node(x, p, origin, inv_dx)
            corner = bx * plane + by * row + bz
            sums = gather_filled(velocity, v, c, p, side[p], corner, plane, row, fx, fy, fz, dx)
            move(x, v, c, f, p, dt, inv_dx, *sums)
            vx, vy, vz = sums[0], sums[1], sums[2]
            fastest = max(fastest, vx * vx + vy * vy + vz * vz)
        report[chunk] = fastest
