"""A run of the engine as a mesh sequence, a raw recording for `ingest mesh`."""

from __future__ import annotations

from typing import Any

import numpy as np

from plop.physics.engine.solver import EngineTrajectory
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.shapes import Body
from plop.recordings.readers.mesh.sequence import MeshSequence


def as_sequence(
    name: str, environment: str, body: Body, motion: ToolMotion, run: EngineTrajectory, facts: dict[str, Any]
) -> MeshSequence:
    """Extract the surface of a body from a run.

    Args:
        name: Name of the episode.
        environment: Name of the object.
        body: The simulated body; its rest positions are those before any load.
        motion: The tool, with a pose at every time of the run.
        run: The trajectory of the body's particles.
        facts: Metadata of the simulator, JSON types only.
    """
    return MeshSequence(
        name=name,
        environment=environment,
        times=run.times,
        vertices=run.positions[:, body.surface].astype(np.float64),
        faces=body.faces,
        tool_vertices=motion.vertices,
        tool_faces=motion.faces,
        world_from_tool=motion.world_from_tool,
        table_z_m=0.0,
        rest_vertices=body.particles.positions[body.surface],
        cut_faces=body.cut_faces,
        source="particle-grid engine",
        facts=facts,
    )
