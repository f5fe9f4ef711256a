"""Move points without volume with the material around them."""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import numpy as np
from numba import njit, prange

from plop.compute.numba_lanes import lane, pack4, spread4
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.transfer import WIDE, base_node, gather, move, spline

_ZERO = np.float32(0)
_QUARTER = np.float32(0.25)
_ONE = np.float32(1)
_TWO = np.float32(2)


@njit(fastmath=True, forceinline=True)
def moments(velocity, corner, side, plane, row, fx, fy, fz):
    """Sum the shares of nodes with material times the ways along two axes, as `gather` sums them times one.

    Returns:
        xx, yy, zz, xy, xz, yz [cells^2]: 1/4, 1/4, 1/4, 0, 0, 0 where there is material everywhere.
    """
    wx, wy = spline(fx), spline(fy)
    w0, w1, w2 = spline(fz)
    d0, d1, d2 = -fz, _ONE - fz, _TWO - fz
    # sums over a column of nodes of 1, z and z^2; then of these times 1, y and y^2, then times 1, x and x^2
    below, middle = pack4((w0, w0 * d0, w0 * d0 * d0, _ZERO)), pack4((w1, w1 * d1, w1 * d1 * d1, _ZERO))
    above = pack4((w2, w2 * d2, w2 * d2 * d2, _ZERO))
    of_1 = of_x = of_xx = of_y = of_xy = of_yy = spread4(_ZERO)
    for i in range(3):
        sums = sums_y = sums_yy = spread4(_ZERO)
        for j in range(3):
            n = corner + i * plane + j * row
            a, b = spread4(velocity[n, side, 3]), spread4(velocity[n + 1, side, 3])
            column = spread4(wy[j]) * (below * a + middle * b + above * spread4(velocity[n + 2, side, 3]))
            way = spread4(np.float32(j) - fy)
            sums += column
            sums_y += way * column
            sums_yy += way * way * column
        weight, way = spread4(wx[i]), spread4(np.float32(i) - fx)
        of_1 += weight * sums
        of_x += way * weight * sums
        of_xx += way * way * weight * sums
        of_y += weight * sums_y
        of_xy += way * weight * sums_y
        of_yy += weight * sums_yy
    xx, yy, zz = lane(of_xx, 0), lane(of_yy, 0), lane(of_1, 2)
    xy, xz, yz = lane(of_xy, 0), lane(of_x, 1), lane(of_y, 1)
    return xx, yy, zz, xy, xz, yz


@kernel(parallel=True)
def advect(x, v, c, f, side, bounds, origin, dims, inv_dx, dt, velocity, report):
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
            total, along_x, along_y, along_z = gather(velocity, WIDE * corner + 4 * side[p], plane, row, fx, fy, fz)
            # what the nodes without material lack: velocity v + dx c way, summed over them
            xx, yy, zz, xy, xz, yz = moments(velocity, corner, side[p], plane, row, fx, fy, fz)
            own = pack4((v[p, 0], v[p, 1], v[p, 2], _ZERO))
            c_x = spread4(dx) * pack4((c[p, 0, 0], c[p, 1, 0], c[p, 2, 0], _ZERO))
            c_y = spread4(dx) * pack4((c[p, 0, 1], c[p, 1, 1], c[p, 2, 1], _ZERO))
            c_z = spread4(dx) * pack4((c[p, 0, 2], c[p, 1, 2], c[p, 2, 2], _ZERO))
            empty = spread4(_ONE - lane(total, 3))
            mx, my, mz = spread4(-lane(along_x, 3)), spread4(-lane(along_y, 3)), spread4(-lane(along_z, 3))
            xx, yy, zz = spread4(_QUARTER - xx), spread4(_QUARTER - yy), spread4(_QUARTER - zz)
            xy, xz, yz = spread4(-xy), spread4(-xz), spread4(-yz)
            total += empty * own + mx * c_x + my * c_y + mz * c_z
            along_x += mx * own + xx * c_x + xy * c_y + xz * c_z
            along_y += my * own + xy * c_x + yy * c_y + yz * c_z
            along_z += mz * own + xz * c_x + yz * c_y + zz * c_z
            vx, vy, vz = move(x, v, c, f, p, dt, inv_dx, total, along_x, along_y, along_z)
            fastest = max(fastest, vx * vx + vy * vy + vz * vz)
        report[chunk] = fastest
