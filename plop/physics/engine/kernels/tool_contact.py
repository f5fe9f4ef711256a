"""The tool in the kernels: how near a particle is, on which side of a blade, and how the tool pushes and rubs.

The tool acts on the particles, not on grid nodes: a node sees the tool only in whole cells, so that a
grid lets tools sink in, or touch early, by an amount that grows with its cells.
"""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from plop.physics.engine.jit import kernel

_ZERO = np.float32(0)
_ONE = np.float32(1)
_HALF = np.float32(0.5)
_TWO = np.float32(2)
_TINY = np.float32(1e-12)
_FAR = np.float32(1e9)
STIFFNESS = np.float32(4)
"""Contact pressure over penetration, in (P-wave modulus / cell): a pressure of 0.2 E sinks in by 0.05 cells."""
_DAMPING = np.float32(0.3)
"""Damping of the contact, share of the critical one."""
_PARALLEL = np.float32(0.999)
"""Cosine from which on two faces are one, or rounding decides [-]."""


@njit(fastmath=True, forceinline=True)
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


@njit(fastmath=True, forceinline=True)
def in_outline(faces, y, z, margin):
    """Tell whether a point of the blade's plane lies inside its outline, widened by `margin` [m]."""
    beyond = -np.float32(1e9)
    for k in range(faces.shape[0]):
        beyond = max(beyond, faces[k, 1] * y + faces[k, 2] * z - faces[k, 3])
    return beyond <= margin


@njit(fastmath=True, forceinline=True)
def half_thickness(thickness, y, z):
    """Half the thickness of a blade at a point of its plane [m]."""
    return max(thickness[3], thickness[0] + thickness[1] * y + thickness[2] * z)


@njit(fastmath=True, forceinline=True)
def solid_height(faces, d, y, z, enough):
    """Signed distance to a convex solid, exact inside, and the face it belongs to; any beyond `enough` [m] will do."""
    height, face = -np.float32(1e9), 0
    for k in range(faces.shape[0]):
        above = faces[k, 0] * d + faces[k, 1] * y + faces[k, 2] * z - faces[k, 3]
        if above > height:
            height, face = above, k
            if height > enough:
                break
    return height, face


@njit(fastmath=True, forceinline=True)
def faces_solid(faces, d, y, z, face, reach):
    """Tell whether going `reach` [m] straight towards a face of a solid ends in the solid, not beside it."""
    d, y, z = d - reach * faces[face, 0], y - reach * faces[face, 1], z - reach * faces[face, 2]
    return solid_height(faces, d, y, z, _ZERO)[0] <= _ZERO


@njit(fastmath=True, forceinline=True)
def tool_gap(kind, faces, thickness, d, y, z, side, cut, reach):
    """Distance from a particle's middle to the tool [m] and the tool's outward normal, in the tool's frame.

    A blade touches only material that it has passed, each side with one of its faces, as far as its outline
    reaches; a solid only particles whose middle lies opposite one of its faces: the distance is huge for those
    that merely reach past its edge, which would make the tool wider by a particle on every side.

    Takes:
        kind, faces, thickness: Tool, see `ToolShape`.
        d, y, z: The particle's middle in the tool's principal frame [m].
        side, cut: Its side, and whether the blade has passed.
        reach: How far from its middle it touches [m].
    """
    if kind == 2:
        height, k = solid_height(faces, d, y, z, reach)
        if height > _ZERO and height <= reach and not faces_solid(faces, d, y, z, k, reach):
            height = np.float32(1e9)
        return height, faces[k, 0], faces[k, 1], faces[k, 2]
    if not cut or not in_outline(faces, y, z, _ZERO):
        return np.float32(1e9), _ONE, _ZERO, _ZERO
    sign = _ONE if side == 0 else -_ONE
    ny, nz = -thickness[1], -thickness[2]
    length = math.sqrt(_ONE + ny * ny + nz * nz)
    return (sign * d - half_thickness(thickness, y, z)) / length, sign / length, ny / length, nz / length


@njit(fastmath=True, forceinline=True)
def turned(f, p, outward):
    """Turn a particle's outward normal as its deformation does: cof(F) n (Nanson 1878), of unit length or 0."""
    x, y, z = outward[p, 0], outward[p, 1], outward[p, 2]
    ax, ay, az = f[p, 0, 0], f[p, 1, 0], f[p, 2, 0]
    bx, by, bz = f[p, 0, 1], f[p, 1, 1], f[p, 2, 1]
    cx, cy, cz = f[p, 0, 2], f[p, 1, 2], f[p, 2, 2]
    nx = x * (by * cz - bz * cy) + y * (cy * az - cz * ay) + z * (ay * bz - az * by)
    ny = x * (bz * cx - bx * cz) + y * (cz * ax - cx * az) + z * (az * bx - ax * bz)
    nz = x * (bx * cy - by * cx) + y * (cx * ay - cy * ax) + z * (ax * by - ay * bx)
    length = max(math.sqrt(nx * nx + ny * ny + nz * nz), _TINY)
    return nx / length, ny / length, nz / length


@njit(fastmath=True, forceinline=True)
def depth_of(faces, k, d, y, z, height):
    """How much deeper than the nearest face, which is at `height`, a face of a solid is [m]."""
    return height - (faces[k, 0] * d + faces[k, 1] * y + faces[k, 2] * z - faces[k, 3])


@njit(fastmath=True, forceinline=True)
def facing(faces, d, y, z, near, nd, ny, nz):
    """Give the direction in which a solid pushes a surface of outward normal n.

    At an edge the solid has no normal of its own, only the surface has: the push goes along -n, as far as the faces
    that meet there allow it, which is its projection on the cone of their normals, of the best two at a corner (Elandt
    et al. 2019: pressure along the normal of the soft surface). With the nearest face's normal a dragged punch would
    plough; with any face's, it would not feel that the surface behind it rises and pushes it on.

    Takes:
        faces, d, y, z: See `tool_gap`.
        near: Faces count that are at most so much deeper than the nearest [m].
        nd, ny, nz: n, in the tool's frame; 0 within the material, where the nearest face pushes.
    """
    height, face = solid_height(faces, d, y, z, _FAR)
    against = _ZERO
    for k in range(faces.shape[0]):
        if depth_of(faces, k, d, y, z, height) < near:
            along = -(faces[k, 0] * nd + faces[k, 1] * ny + faces[k, 2] * nz)
            if along > against:
                against, face = along, k
    ax, ay, az = faces[face, 0], faces[face, 1], faces[face, 2]
    if against == _ZERO:
        return ax, ay, az
    most, other, share, second = against * against, face, against, _ZERO
    for k in range(faces.shape[0]):
        if depth_of(faces, k, d, y, z, height) < near:
            along = -(faces[k, 0] * nd + faces[k, 1] * ny + faces[k, 2] * nz)
            alike = ax * faces[k, 0] + ay * faces[k, 1] + az * faces[k, 2]
            if along > alike * against and alike < _PARALLEL:
                one = (against - alike * along) / (_ONE - alike * alike)
                two = (along - alike * against) / (_ONE - alike * alike)
                if one * against + two * along > most:
                    most, other, share, second = one * against + two * along, k, one, two
    share, second = share / math.sqrt(most), second / math.sqrt(most)
    bx, by, bz = faces[other, 0], faces[other, 1], faces[other, 2]
    return share * ax + second * bx, share * ay + second * by, share * az + second * bz


@kernel(parallel=True)
def push_tool(
    x,
    v,
    mass,
    radius,
    side,
    cut,
    held,
    outward,
    f,
    bounds,
    kind,
    pose,
    faces,
    thickness,
    friction,
    modulus,
    density,
    dx,
    dt,
    impulses,
):
    """Push particles that reach into the tool out of it, and hold or rub them along with it.

    The push is a stiff, damped spring over each particle's share of the surface, and so is what holds a particle at
    the place where the tool touched it, until it slips: Coulomb's law limits the tangential impulse by the push's
    (Cundall & Strack 1979). An impulse that only stops a particle's own slip holds nothing, since the grid shares it
    with all the material around and the next step finds nearly the same slip. The springs' stiffness follows the
    object's, so that they set no shorter time step than the object's own waves.

    Takes:
        x, v, mass, radius: Positions [N, 3] [m], velocities (updated) [N, 3] [m/s], masses [N] [kg], distance
            from a particle to the end of its material [N] [m].
        side, cut: Sides [N] and passage of the blade [N].
        held: Updated: way along the tool's surface since it touched a particle, as far as friction holds it [N, 3] [m].
        outward, f: Normal of the undeformed surface, 0 within the material [N, 3]; deformation gradient [N, 3, 3].
        bounds: Chunks [chunks + 1].
        kind, pose, faces, thickness: Tool, see `ToolShape` and `kernel_poses`.
        friction: Coulomb coefficient [-].
        modulus, density: P-wave modulus [Pa] and density [kg/m^3] of the object.
        dx, dt: Cell [m] and step [s].
        impulses: Written, [chunks, 3]: impulse on the object [N s].
    """
    rate = _TWO * STIFFNESS * modulus / (density * dx * dx)
    loss = _TWO * _DAMPING * math.sqrt(rate)
    whole = density * dx * dx * dx / np.float32(8)
    for chunk in prange(bounds.shape[0] - 1):
        px, py, pz = _ZERO, _ZERO, _ZERO
        for p in range(bounds[chunk], bounds[chunk + 1]):
            rx, ry, rz = x[p, 0] - pose[0, 0], x[p, 1] - pose[0, 1], x[p, 2] - pose[0, 2]
            d = rx * pose[1, 0] + ry * pose[1, 1] + rz * pose[1, 2]
            y = rx * pose[2, 0] + ry * pose[2, 1] + rz * pose[2, 2]
            z = rx * pose[3, 0] + ry * pose[3, 1] + rz * pose[3, 2]
            gap, nd, ny, nz = tool_gap(kind, faces, thickness, d, y, z, side[p], cut[p], radius[p])
            depth = radius[p] - gap
            push = _ZERO
            if depth > _ZERO:
                if kind == 2:
                    mx, my, mz = turned(f, p, outward)
                    md = mx * pose[1, 0] + my * pose[1, 1] + mz * pose[1, 2]
                    me = mx * pose[2, 0] + my * pose[2, 1] + mz * pose[2, 2]
                    mf = mx * pose[3, 0] + my * pose[3, 1] + mz * pose[3, 2]
                    nd, ny, nz = facing(faces, d, y, z, dx, md, me, mf)
                wx = nd * pose[1, 0] + ny * pose[2, 0] + nz * pose[3, 0]
                wy = nd * pose[1, 1] + ny * pose[2, 1] + nz * pose[3, 1]
                wz = nd * pose[1, 2] + ny * pose[2, 2] + nz * pose[3, 2]
                ux = v[p, 0] - pose[4, 0] - pose[5, 1] * rz + pose[5, 2] * ry
                uy = v[p, 1] - pose[4, 1] - pose[5, 2] * rx + pose[5, 0] * rz
                uz = v[p, 2] - pose[4, 2] - pose[5, 0] * ry + pose[5, 1] * rx
                along = ux * wx + uy * wy + uz * wz
                # a particle that lies on the surface stands for less mass and as much surface as one a layer below
                stiff = min(_TWO, max(_ONE, whole / mass[p])) * rate
                push = dt * (stiff * depth - loss * along)
            if push <= _ZERO:
                held[p, 0], held[p, 1], held[p, 2] = _ZERO, _ZERO, _ZERO
                continue
            tx, ty, tz = ux - along * wx, uy - along * wy, uz - along * wz
            hx, hy, hz = held[p, 0] + dt * tx, held[p, 1] + dt * ty, held[p, 2] + dt * tz
            out = hx * wx + hy * wy + hz * wz
            hx, hy, hz = hx - out * wx, hy - out * wy, hz - out * wz
            bx, by, bz = stiff * hx + loss * tx, stiff * hy + loss * ty, stiff * hz + loss * tz
            rub = dt * math.sqrt(bx * bx + by * by + bz * bz)
            keep = min(_ONE, friction * push / max(rub, _TINY))
            ax, ay, az = push * wx - dt * keep * bx, push * wy - dt * keep * by, push * wz - dt * keep * bz
            # a spring that slips is no longer than what it holds
            held[p, 0], held[p, 1], held[p, 2] = keep * hx, keep * hy, keep * hz
            v[p, 0] += ax
            v[p, 1] += ay
            v[p, 2] += az
            px += mass[p] * ax
            py += mass[p] * ay
            pz += mass[p] * az
        impulses[chunk, 0], impulses[chunk, 1], impulses[chunk, 2] = px, py, pz


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
def table_gaps(x, radius, origin, dims, inv_dx, table, gaps):
    """Find for every node how close the material around it is to the table.

    Without this a grid makes things touch that are still a cell apart.

    Takes:
        x, radius: Positions [N, 3] [m], distance from a particle to the end of its material [N] [m].
        origin, dims, inv_dx: Grid.
        table: Height of the table [m], -inf when there is none.
        gaps: Written, [nodes]: smallest gap to the table [m].
    """
    row, plane = dims[2], dims[1] * dims[2]
    near = np.float32(0.25) / inv_dx
    for node in range(dims[0] * plane):
        gaps[node] = near
    for p in range(x.shape[0]):
        below = x[p, 2] - table - radius[p]
        if below >= near:
            continue
        bx = int((x[p, 0] - origin[0]) * inv_dx - _HALF)
        by = int((x[p, 1] - origin[1]) * inv_dx - _HALF)
        bz = int((x[p, 2] - origin[2]) * inv_dx - _HALF)
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    node = (bx + i) * plane + (by + j) * row + bz + k
                    gaps[node] = min(gaps[node], below)
