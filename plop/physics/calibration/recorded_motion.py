"""A recorded motion as the engine's input: initial particles, the tool, and points to compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.fill import fill_surface, surface_parts
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolKind, ToolMotion, ToolShape
from plop.recordings.readers.mesh.sequence import MeshSequence, begun_at_rest


@dataclass(frozen=True)
class Case:
    """One episode to be simulated by the engine."""

    name: str
    particles: Particles
    """Material first, then one tracer for each point to compare."""
    tool: ToolMotion
    times: np.ndarray
    """Start, then the times of the observed frames, [1 + T] [s]."""
    observed: np.ndarray
    """Measured points at the frames, [T, M, 3] [m]; NaN = not measured."""
    table_z_m: float | None

    @property
    def tracers(self) -> slice:
        """Rows of the compared points among the particles."""
        return slice(len(self.particles) - self.observed.shape[1], None)

    def predict(self, material: Material, config: EngineConfig) -> np.ndarray:
        """Run the engine and return the compared points at the observed frames, [T, M, 3] [m]."""
        run = simulate(self.particles, material, self.tool, self.times, config)
        return run.positions[1:, self.tracers].astype(np.float64)


def case_from_sequence(sequence: MeshSequence, spacing_m: float) -> Case:
    """Prepare a mesh sequence: fill its resting surface, with tracers at its vertices.

    A surface that is cut already (two parts that still coincide) determines on which side of the blade each
    particle will be. When the first frame lies after time 0, the episode starts at rest at time 0, and the
    tool's motion is extrapolated backwards at its first velocity.

    Args:
        sequence: The episode.
        spacing_m: Distance of the particles [m].
    """
    rest, faces = sequence.rest, sequence.faces
    parts = surface_parts(faces, len(rest))
    part_sides = sides_of_parts(sequence, parts)
    positions, volumes, radii, sides = [], [], [], []
    for part, side in enumerate(part_sides):
        own = faces[parts[faces[:, 0]] == part]
        used, numbered = np.unique(own, return_inverse=True)
        filled, volume, radius = fill_surface(rest[used], numbered.reshape(-1, 3), spacing_m)
        positions.append(filled)
        volumes.append(volume)
        radii.append(radius)
        sides.append(np.full(len(filled), side))
    none = np.zeros(len(rest))
    particles = Particles(
        np.concatenate([*positions, rest]),
        np.concatenate([*volumes, none]),
        sides=np.concatenate([*sides, part_sides[parts]]),
        radii=np.concatenate([*radii, none]),
    )
    begun = begun_at_rest(sequence)
    tool = ToolMotion(sequence.tool_vertices, sequence.tool_faces, begun.times, begun.world_from_tool)
    return Case(sequence.name, particles, tool, begun.times, begun.vertices[1:], sequence.table_z_m)


def sides_of_parts(sequence: MeshSequence, parts: np.ndarray) -> np.ndarray:
    """Return on which side of the blade each part of a surface is: +1, -1, or all 0 unless there are two parts.

    Args:
        sequence: The episode.
        parts: Part of every vertex, see `surface_parts`.
    """
    count = int(parts.max()) + 1
    if count != 2:
        return np.zeros(count, int)
    tool = ToolMotion(sequence.tool_vertices, sequence.tool_faces, sequence.times, sequence.world_from_tool)
    normal, offset = blade_plane(tool)
    middles = np.stack([sequence.rest[parts == part].mean(0) for part in range(count)])
    return np.where(middles @ normal > offset, 1, -1)


def blade_plane(tool: ToolMotion) -> tuple[np.ndarray, float]:
    """Plane of a blade at the start of its motion: normal [3] in world and offset along it [m]."""
    shape = ToolShape.from_mesh(tool.vertices, tool.faces, ToolKind.BLADE)
    pose = tool.world_from_tool[0]
    normal = pose[:3, :3] @ shape.axes[:, 0]
    return normal, float(normal @ (pose[:3, :3] @ shape.center + pose[:3, 3]))
