"""The kernels of half a time step in one call: a call from Python costs as much as a kernel on few particles."""

# Numba infers the types of kernels; their docstrings say what they take.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.grid import grid_velocities
from plop.physics.engine.kernels.tool_contact import mark_sides, push_tool, table_gaps
from plop.physics.engine.kernels.toughness import resist_cut
from plop.physics.engine.kernels.tracers import advect
from plop.physics.engine.kernels.transfer import add_chunks, g2p, stress_p2g
from plop.physics.engine.tool_motion import ToolKind

_BLADE = int(ToolKind.BLADE)


@kernel()
def touch(pushed, fixed, bounds, tracers, tool, band, friction, modulus, density, dx, dt, pushes, impulse):
    """Let the tool cut and push particles.

    Takes:
        pushed: x, v, mass, radius, side, cut, held, outward and f of `push_tool`.
        fixed: Sides given beforehand, see `mark_sides`.
        bounds: Chunks of particles.
        tracers: x, side, cut, fixed, radius and chunks of the tracers.
        tool: Kind, pose, faces and thickness, see `ToolShape` and `kernel_poses`.
        band, friction, modulus, density, dx, dt: See `mark_sides` and `push_tool`.
        pushes: Written, see `push_tool`.
        impulse: The tool's on the object is added, [3] [N s].
    """
    x, v, mass, radius, side, cut, held, outward, f = pushed
    kind, pose, faces, thickness = tool
    if kind == _BLADE:
        mark_sides(x, side, cut, fixed, radius, pose, faces, thickness, band, bounds)
        places, sides, passed, given, radii, chunks = tracers
        mark_sides(places, sides, passed, given, radii, pose, faces, thickness, band, chunks)
    push_tool(
        x, v, mass, radius, side, cut, held, outward, f, bounds, kind, pose, faces, thickness,
        friction, modulus, density, dx, dt, pushes,
    )  # fmt: skip
    for chunk in range(pushes.shape[0]):
        for q in range(3):
            impulse[q] += pushes[chunk, q]


@njit
def extremes(report, tracer_report):
    """Give the highest squared speed and the smallest volume ratio, or no numbers where one of them is none.

    Without the freedoms of fast arithmetic, which takes every number for finite.
    """
    fastest, smallest, total = np.float32(0), np.float32(1), np.float32(0)
    for chunk in range(report.shape[0]):
        fastest, smallest = max(fastest, report[chunk, 0]), min(smallest, report[chunk, 1])
        total += report[chunk, 0] + report[chunk, 1]
    for chunk in range(tracer_report.shape[0]):
        fastest = max(fastest, tracer_report[chunk])
        total += tracer_report[chunk]
    if not math.isfinite(total):
        return np.float32(np.nan), np.float32(np.nan)
    return fastest, smallest


@kernel()
def advance(body, tracers, frame, elastic, dt, decay, chunks, nodes, edges, table, friction, gravity, density, impulse):
    """Transfer to the grid, advance its velocities, and transfer back.

    Takes:
        body: x, v, c, f, mass, volume, side, cut, radius, and the chunks' bounds and planes, see `stress_p2g`.
        tracers: x, v, c, f, side and chunks of the tracers.
        frame: Origin, nodes per axis, 1/dx and dx of the grid.
        elastic: Law, Lame parameters, viscosity and the stress that effects add, see `stress_p2g`.
        dt, decay: See `stress_p2g`.
        chunks: Grids of the chunks; reports of particles and tracers, see `g2p` and `advect`.
        nodes: Mass and momentum, passed mass, gaps, velocity and impulses of the whole grid, see `grid_velocities`.
        edges: Pose, edges and toughness, see `resist_cut`; no edges where nothing resists.
        table, friction, gravity, density: See `grid_velocities`; the first is height and whether its cone is square.
        impulse: Those of table and tool on the object are added, [2, 3] [N s].

    Returns:
        Highest squared speed [m^2/s^2] and smallest volume ratio; no numbers where a particle's are none.
    """
    x, v, c, f, mass, volume, side, cut, radius, bounds, planes = body
    origin, dims, inv_dx, dx = frame
    law, mu, lam, eta, extra = elastic
    chunk_grid, chunk_passed, report, tracer_report = chunks
    grid, passed, gaps, velocity, impulses = nodes
    stress_p2g(
        x, v, c, f, mass, volume, side, cut, bounds, planes, origin, dims, inv_dx, dt, decay, law, mu, lam, eta, extra,
        chunk_grid, chunk_passed,
    )  # fmt: skip
    add_chunks(chunk_grid, chunk_passed, planes, dims, grid, passed)
    pose, places, toughness = edges
    if places.shape[0] > 0:
        pushed = resist_cut(grid, passed, origin, dims, inv_dx, dt, pose, places, toughness, density)
        for q in range(3):
            impulse[1, q] += pushed[q]
    height, pyramid = table
    table_gaps(x, radius, origin, dims, inv_dx, height, gaps)
    grid_velocities(
        grid, passed, origin, dims, dx, dt, gravity, height, pyramid, friction, density, gaps, velocity, impulses
    )
    g2p(x, v, c, f, side, bounds, origin, dims, inv_dx, dt, velocity, report)
    points, speeds, affine, gradients, sides, chunks_of = tracers
    advect(points, speeds, affine, gradients, sides, chunks_of, origin, dims, inv_dx, dt, velocity, tracer_report)
    for plane in range(dims[0]):
        for q in range(3):
            impulse[0, q] += impulses[plane, q]
    return extremes(report, tracer_report)
