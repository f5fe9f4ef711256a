"""The tool in the kernels: how near a point is, on which side of a blade, and what a touch does to a velocity."""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from plop.physics.jit import kernel

_ZERO = np.float32(0)
_ONE = np.float32(1)
_HALF = np.float32(0.5)
_TINY = np.float32(1e-12)
_RECOVERY_S = np.float32(0.020)
"""Time in which material leaves a tool that it has got into [s]."""


@njit(fastmath=True)
def coulomb(vx, vy, vz, ux, uy, uz, nx, ny, nz, friction):
    """Keep a velocity v [m/s] out of an obstacle that moves with u and whose outward unit normal is n."""
    rx, ry, rz = vx - ux, vy - uy, vz - uz
    approach = rx * nx + ry * ny + rz * nz
    if approach >= _ZERO:
        return vx, vy, vz
    tx, ty, tz = rx - approach * nx, ry - approach * ny, rz - approach * nz
    slip = math.sqrt(tx * tx + ty * ty + tz * tz)
    keep = max(_ZERO, _ONE + friction * approach / max(slip, _TINY))
    return ux + keep * tx, uy + keep * ty, uz + keep * tz


@njit(fastmath=True)
def in_outline(faces, y, z, margin):
    """Tell whether a point of the blade's plane lies inside its outline, widened by `margin` [m]."""
    beyond = -np.float32(1e9)
    for k in range(faces.shape[0]):
        beyond = max(beyond, faces[k, 1] * y + faces[k, 2] * z - faces[k, 3])
    return beyond <= margin


@njit(fastmath=True)
def half_thickness(thickness, y, z):
    """Half the thickness of a blade at a point of its plane [m]."""
    return max(thickness[3], thickness[0] + thickness[1] * y + thickness[2] * z)


@njit(fastmath=True)
def solid_height(faces, d, y, z):
    """Signed distance to a convex solid, exact inside, and the face it belongs to."""
    height, face = -np.float32(1e9), 0
    for k in range(faces.shape[0]):
        above = faces[k, 0] * d + faces[k, 1] * y + faces[k, 2] * z - faces[k, 3]
        if above > height:
            height, face = above, k
    return height, face


@njit(fastmath=True)
def touch_tool(kind, pose, faces, thickness, px, py, pz, vx, vy, vz, side, friction, reach, gap):
    """Keep one field's velocity at a node out of the tool; gives the new velocity [m/s].

    Material that has got into the tool (gap < 0) is led out of it within `_RECOVERY_S`: a grid alone lets the
    tool sink into the object by an amount that grows with its cells.
    """
    rx, ry, rz = px - pose[0, 0], py - pose[0, 1], pz - pose[0, 2]
    d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
    y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
    z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
    if kind == 1:
        sign = _ONE if side == 0 else -_ONE
        depth = half_thickness(thickness, y, z) - sign * d
        if depth <= _ZERO or depth > reach or not in_outline(faces, y, z, _ZERO):
            return vx, vy, vz
        nd, ny, nz = sign, -thickness[1], -thickness[2]
        length = math.sqrt(_ONE + ny * ny + nz * nz)
        nd, ny, nz = nd / length, ny / length, nz / length
    else:
        height, k = solid_height(faces, d, y, z)
        if height >= _ZERO:
            return vx, vy, vz
        nd, ny, nz = faces[k, 0], faces[k, 1], faces[k, 2]
    ux = pose[4, 0] + pose[5, 1] * rz - pose[5, 2] * ry
    uy = pose[4, 1] + pose[5, 2] * rx - pose[5, 0] * rz
    uz = pose[4, 2] + pose[5, 0] * ry - pose[5, 1] * rx
    out = max(_ZERO, -gap) / _RECOVERY_S
    wx = nd * pose[1, 0] + ny * pose[2, 0] + nz * pose[3, 0]
    wy = nd * pose[1, 1] + ny * pose[2, 1] + nz * pose[3, 1]
    wz = nd * pose[1, 2] + ny * pose[2, 2] + nz * pose[3, 2]
    return coulomb(vx, vy, vz, ux + out * wx, uy + out * wy, uz + out * wz, wx, wy, wz, friction)


@kernel(parallel=True)
def mark_sides(x, side, cut, fixed, radius, pose, faces, thickness, band, bounds):
    """Give particles the side of the blade on which they are, and keep it for those that it has passed.

    Takes:
        x: Positions [N, 3] [m].
        side, cut: Updated, [N]: 0 in front of the blade's normal, 1 behind it; passed or not.
        fixed: Particles whose side was given beforehand and must not change [N].
        radius: Updated where the blade leaves a face through a particle's cell: its material then ends at the
            blade, however far its middle is from it [N] [m].
        pose, faces, thickness: Blade, see `kernel_poses` and `ToolShape`.
        band: Distance within which a passing blade separates [m].
        bounds: Chunks [chunks + 1].
    """
    for chunk in prange(bounds.shape[0] - 1):
        for p in range(bounds[chunk], bounds[chunk + 1]):
            if cut[p]:
                continue
            rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
            d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
            if not fixed[p]:
                side[p] = 0 if d > _ZERO else 1
            if abs(d) < band:
                y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
                z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
                if in_outline(faces, y, z, _ZERO):
                    cut[p] = True
                    if not fixed[p] and abs(d) < radius[p] + radius[p]:
                        radius[p] = abs(d)


@kernel()
def contact_gaps(x, radius, side, cut, origin, dims, inv_dx, table, kind, pose, faces, thickness, gaps):
    """Find for every node how close the material around it is to table and tool.

    Without this a grid makes things touch that are still a cell apart.

    Takes:
        x, radius, side, cut: Positions [N, 3] [m], distance from a particle to the end of its material [N] [m],
            sides and passage of the blade [N].
        origin, dims, inv_dx: Grid.
        table: Height of the table [m], -inf when there is none.
        kind, pose, faces, thickness: Tool, see `ToolShape` and `kernel_poses`.
        gaps: Written, [nodes, 3]: smallest gap to the table, to the tool in field 0 and in field 1 [m].
    """
    row, plane = dims[2], dims[1] * dims[2]
    near = np.float32(0.25) / inv_dx
    for node in range(dims[0] * plane):
        gaps[node, 0], gaps[node, 1], gaps[node, 2] = near, near, near
    for p in range(x.shape[0]):
        below = x[p, 2] - table - radius[p]
        beside = near
        if kind != 0:
            rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
            d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
            y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
            z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
            if kind == 2:
                beside = solid_height(faces, d, y, z)[0] - radius[p]
            elif cut[p] and in_outline(faces, y, z, _ZERO):
                beside = (d if side[p] == 0 else -d) - half_thickness(thickness, y, z) - radius[p]
        if below >= near and beside >= near:
            continue
        bx = int((x[p, 0] - origin[0]) * inv_dx - _HALF)
        by = int((x[p, 1] - origin[1]) * inv_dx - _HALF)
        bz = int((x[p, 2] - origin[2]) * inv_dx - _HALF)
        q = 1 + side[p]
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    node = (bx + i) * plane + (by + j) * row + bz + k
                    gaps[node, 0] = min(gaps[node, 0], below)
                    gaps[node, q] = min(gaps[node, q], beside)
