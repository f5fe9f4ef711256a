"""What every foreign world simulates: a soft object on a table, a rigid tool that presses, pushes or drags it.

A `World` declares what is true, a `Motion` what the tool does; each simulator turns the two into plop's raw mesh
sequence. Declared is not effective: a coarse mesh of linear tetrahedra is stiffer than its material, and a contact
that is solved per time step creeps. `benchmarks.worlds.laws` measures both.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.motions import led_along
from plop.physics.scenes.names import one_of
from plop.physics.scenes.shapes import Shape, lattice_counts, whole_body
from plop.physics.scenes.tools import Mesh, box_mesh, cylinder_mesh
from plop.recordings.readers.mesh.sequence import MeshSequence

KINDS = ("press", "double-press", "push", "drag", "rest")
GRAVITY_M_S2 = 9.81
FRAME_RATE_HZ = 30.0
CELLS_M, TIME_STEP_S = {"drake": 0.0075, "mujoco": 0.0055}, {"drake": 0.005, "mujoco": 0.002}
"""Edge of a mesh's cells [m] and time step [s] of each simulator in the missing-physics benchmark. A press needs
10 to 20 % more force than with cells of 5 and 4 mm; with those Drake takes five times as long."""
SETTLE_S = 0.6
"""How long the object lies untouched before the recording begins [s]."""
_GAP_M = 0.003
"""Free way before the tool touches [m]."""
_REST_S = 0.2


@dataclass(frozen=True)
class World:
    """Declared truth of one object, its table and its tool."""

    name: str = "block"
    shape: Shape = Shape("block", (0.060, 0.040, 0.040))
    taper: float = 0.0
    """Share by which the object narrows from the table to its top [-]."""
    youngs_modulus_pa: float = 1.5e4
    poisson: float = 0.4
    density_kg_m3: float = 1000.0
    law: str = "corotated"
    """Elastic law; what there is depends on the simulator."""
    damping_per_s: float = 2.0
    """Velocity damping: a free velocity falls as exp(-damping t) [1/s]."""
    stiffness_damping_s: float = 0.0
    """Damping in proportion to the stiffness (Rayleigh's beta) [s]."""
    table_friction: float = 0.5
    tool_friction: float = 0.5
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    """Tilt of the table: gravity leans so far towards +x and towards +y [deg]."""
    contact_pa_m: float = 2e7
    """How hard table and tool are: pressure over penetration [Pa/m]. Drake's own default, 2e8 for this table, makes the
    contact rattle in every time step, so that a block creeps down a tilt on which it ought to stick."""
    contact_time_s: float = 0.004
    """Time in which MuJoCo's soft contact gives way and comes back [s]; twice the time step at least."""
    cells_m: float = 0.007
    """Edge of the mesh's cells, each of six tetrahedra [m]."""
    time_step_s: float = 0.002

    @property
    def gravity_m_s2(self) -> np.ndarray:
        """Acceleration of free fall in the table's frame, [3] [m/s^2]."""
        x, y = np.tan(np.deg2rad(self.tilt_deg))
        return GRAVITY_M_S2 * np.array([x, y, -1.0]) / np.sqrt(x * x + y * y + 1)


@dataclass(frozen=True)
class Motion:
    """What the tool does in one episode."""

    kind: str = "press"
    """One of KINDS."""
    tool: str = "box"
    """box or cylinder."""
    x_m: float = 0.0
    """Where the tool meets the object, from its middle [m]."""
    y_m: float = 0.0
    yaw_rad: float = 0.0
    """Turn of the tool about the vertical; pushes and drags go along its x axis [rad]."""
    depth_m: float = 0.007
    """Depth of a press, or of the press before a drag [m]."""
    aside_m: float = 0.015
    """Way of a push or drag, or from the first press to the second [m]."""
    speed_m_s: float = 0.05

    def __post_init__(self) -> None:
        one_of(self.kind, KINDS, "motion", where="motion.kind")
        one_of(self.tool, ("box", "cylinder"), "tool", where="motion.tool")


@dataclass(frozen=True)
class TetrahedralMesh:
    """A shape cut into tetrahedra."""

    nodes: np.ndarray
    """[N, 3] [m]."""
    tetrahedra: np.ndarray
    """[E, 4], positively oriented."""
    surface: np.ndarray
    """Nodes on the surface, [V]."""
    faces: np.ndarray
    """Triangles over the surface's nodes, outward, [F, 3]."""


def tetrahedral_mesh(world: World) -> TetrahedralMesh:
    """Cut a world's object into tetrahedra of the declared edge, mirrored in its middle planes.

    Each cell of a lattice is cut into six tetrahedra about its diagonal (Kuhn 1960). The diagonals point away from the
    middle, so that a mesh with even numbers of cells prefers no side, and the
    corners of a round object are halved rather than flat.
    """
    body = whole_body(world.shape, world.cells_m)
    counts = lattice_counts(world.shape, world.shape.size_m[0], world.cells_m)
    nodes = body.particles.positions.copy()
    nodes[:, :2] *= 1 - world.taper * nodes[:, 2:] / world.shape.height_m
    index = np.arange(len(nodes)).reshape([n + 1 for n in counts])
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1).reshape(-1, 3)
    outward = 2 * cells + 1 >= np.array(counts)
    found = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        corner = np.zeros((len(cells), 4, 3), int)
        for step, axis in enumerate(order, 1):
            corner[:, step:, axis] = 1
        corner = np.where(outward[:, None], corner, 1 - corner) + cells[:, None]
        found.append(index[tuple(np.moveaxis(corner, -1, 0))])
    tetrahedra = np.concatenate(found)
    inverted = _volumes(nodes, tetrahedra) < 0
    tetrahedra[inverted, :2] = tetrahedra[inverted, 1::-1]
    return TetrahedralMesh(nodes, tetrahedra, *boundary(tetrahedra))


def node_volumes(mesh: TetrahedralMesh) -> np.ndarray:
    """Give each node a quarter of every tetrahedron around it, [N] [m^3]."""
    share = np.repeat(_volumes(mesh.nodes, mesh.tetrahedra) / 4, 4)
    return np.bincount(mesh.tetrahedra.ravel(), share, len(mesh.nodes))


def _volumes(nodes: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    edges = nodes[tetrahedra[:, 1:]] - nodes[tetrahedra[:, :1]]
    return np.asarray(np.linalg.det(edges)) / 6


def boundary(tetrahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the nodes on the surface [V], and its faces, outward, in their numbers [F, 3]."""
    sides = tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(sides, 1), axis=0, return_index=True, return_counts=True)
    surface, faces = np.unique(sides[first[count == 1]], return_inverse=True)
    return surface, faces.reshape(-1, 3)


def tool_mesh(world: World, motion: Motion) -> Mesh:
    """Build the tool in proportion to the object, in its own frame."""
    across, height = min(world.shape.size_m[:2]), world.shape.height_m
    if motion.kind == "push":
        return box_mesh((0.4 * across, 0.7 * across, 0.7 * height))
    if motion.tool == "cylinder":
        return cylinder_mesh(0.3 * across, 0.6 * height)
    return box_mesh((0.5 * across, 0.5 * across, 0.6 * height))


def tool_motion(world: World, motion: Motion) -> ToolMotion:
    """Give the tool and its poses at the frames."""
    knots_s, points = _path(world, motion)
    times = np.arange(int(np.ceil(knots_s[-1] * FRAME_RATE_HZ - 1e-9)) + 1) / FRAME_RATE_HZ
    return ToolMotion(*tool_mesh(world, motion), times, led_along(knots_s, points, motion.yaw_rad, times))


def _path(world: World, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the tool's way: times [K] [s] and points [K, 3] [m]."""
    along = np.array([np.cos(motion.yaw_rad), np.sin(motion.yaw_rad), 0.0])
    place = np.array([motion.x_m, motion.y_m, 0.0])
    top = place + [0, 0, world.shape.height_m]
    gap, down, aside = np.array([0, 0, _GAP_M]), np.array([0, 0, -motion.depth_m]), motion.aside_m * along
    if motion.kind == "push":
        reach = world.shape.reach_m(along[:2]) + _GAP_M + 0.2 * min(world.shape.size_m[:2])
        start = place - (reach + place @ along) * along + [0, 0, 0.003]
        legs = [start, start + (_GAP_M + motion.aside_m) * along]
    elif motion.kind == "drag":
        legs = [top + gap, top + down, top + down + aside]
    elif motion.kind == "press":
        legs = [top + gap, top + down, top + gap]
    elif motion.kind == "double-press":
        legs = [top + gap, top + down, top + gap, top + aside + gap, top + aside + down, top + aside + gap]
    else:
        legs = [top + [0, 0, 0.1], top + [0, 0, 0.1 - motion.aside_m]]
    times, points = [0.0], [legs[0]]
    for place in legs[1:]:
        times.append(times[-1] + float(np.linalg.norm(place - points[-1])) / motion.speed_m_s)
        times.append(times[-1] + _REST_S)
        points += [place, place]
    return np.array(times), np.array(points)


@dataclass(frozen=True)
class Simulated:
    """What a simulator gives of a motion."""

    nodes: np.ndarray
    """Places of all nodes at the tool's times, [T, N, 3] [m]."""
    tool_force: np.ndarray
    """Mean force of the tool on the object since the frame before, [T, 3] [N]."""


def as_sequence(
    world: World, motion: Motion, tool: ToolMotion, mesh: TetrahedralMesh, found: Simulated, source: str, name: str
) -> MeshSequence:
    """Take the surface of a simulated object as plop's raw recording; the tool's force is among its facts."""
    facts: dict[str, Any] = {"world": asdict(world), "motion": asdict(motion), "simulator": source}
    facts["tool_force_n"] = found.tool_force.tolist()
    return MeshSequence(
        name=name,
        environment=world.name,
        times=tool.times,
        vertices=found.nodes[:, mesh.surface],
        faces=mesh.faces,
        tool_vertices=tool.vertices,
        tool_faces=tool.faces,
        world_from_tool=tool.world_from_tool,
        rest_vertices=mesh.nodes[mesh.surface],
        source=source,
        facts=facts,
    )
