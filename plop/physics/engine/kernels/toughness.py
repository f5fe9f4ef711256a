"""Toughness: what the cutting edge spends on new surface."""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np

from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.transfer import spline

_ZERO = np.float32(0)
_HALF = np.float32(0.5)
_ONE = np.float32(1)


@kernel()
def resist_cut(grid, passed, origin, dims, inv_dx, dt, pose, edges, toughness, density):
    """Push uncut material along with the cutting edge, with `toughness` newtons a metre of edge [J/m^2].

    The impulse at most makes the material follow the edge. Its reaction is what the cut costs:
    force times path = toughness times area.

    Returns:
        Impulse on the object [3] [N s].
    """
    total = np.zeros(3, np.float32)
    cell = density / (inv_dx * inv_dx * inv_dx)
    row, plane = dims[2], dims[1] * dims[2]
    for e in range(edges.shape[0]):
        y, z = edges[e, 0], edges[e, 1]
        point = pose[0] + y * pose[2] + z * pose[3]
        ux = pose[4, 0] + pose[5, 1] * (point[2] - pose[0, 2]) - pose[5, 2] * (point[1] - pose[0, 1])
        uy = pose[4, 1] + pose[5, 2] * (point[0] - pose[0, 0]) - pose[5, 0] * (point[2] - pose[0, 2])
        uz = pose[4, 2] + pose[5, 0] * (point[1] - pose[0, 1]) - pose[5, 1] * (point[0] - pose[0, 0])
        gx, gy, gz = (point[0] - origin[0]) * inv_dx, (point[1] - origin[1]) * inv_dx, (point[2] - origin[2]) * inv_dx
        bx, by, bz = int(gx - _HALF), int(gy - _HALF), int(gz - _HALF)
        if not (0 <= bx < dims[0] - 2 and 0 <= by < dims[1] - 2 and 0 <= bz < dims[2] - 2):
            continue
        wx, wy, wz = spline(gx - np.float32(bx)), spline(gy - np.float32(by)), spline(gz - np.float32(bz))
        m, rest, sx, sy, sz = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    node, w = (bx + i) * plane + (by + j) * row + bz + k, wx[i] * wy[j] * wz[k]
                    m += w * (grid[node, 0] + grid[node, 4])
                    rest += w * (grid[node, 0] + grid[node, 4] - passed[node])
                    sx += w * (grid[node, 1] + grid[node, 5])
                    sy += w * (grid[node, 2] + grid[node, 6])
                    sz += w * (grid[node, 3] + grid[node, 7])
        speed = math.sqrt(ux * ux + uy * uy + uz * uz)
        if speed < np.float32(1e-6) or rest < np.float32(0.1) * cell:
            continue
        nx, ny, nz = ux / speed, uy / speed, uz / speed
        lag = speed - (sx * nx + sy * ny + sz * nz) / m
        impulse = min(toughness * edges[e, 2] * min(_ONE, rest / cell / _HALF) * dt, max(_ZERO, lag) * m)
        share = impulse / m
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    node, w = (bx + i) * plane + (by + j) * row + bz + k, wx[i] * wy[j] * wz[k]
                    for q in range(0, 8, 4):
                        push = share * w * grid[node, q]
                        grid[node, q + 1] += push * nx
                        grid[node, q + 2] += push * ny
                        grid[node, q + 3] += push * nz
        total[0] += impulse * nx
        total[1] += impulse * ny
        total[2] += impulse * nz
    return total
