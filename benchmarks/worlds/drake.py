"""Drake as a foreign world: implicit finite elements (linear tetrahedra) with contact constraints.

`pip install -e '.[worlds]'`. The tool is a body too heavy to be moved, whose place and velocity are set in every step.
Source: Han, Masterjohn & Castro, A Convex Formulation of Frictional Contact between Rigid and Deformable Bodies
(IEEE RA-L 2023).
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.worlds.needs import needed
from benchmarks.worlds.scene import (
    SETTLE_S,
    Motion,
    Simulated,
    TetrahedralMesh,
    World,
    as_sequence,
    tetrahedral_mesh,
    tool_motion,
)
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.names import one_of
from plop.recordings.readers.mesh.sequence import MeshSequence

LAWS = {
    "linear": "kLinear",
    "corotated": "kCorotated",
    "linear-corotated": "kLinearCorotated",
    "neo-hookean": "kNeoHookean",
}
_TOOL_KG = 1e5
_TABLE_M = 0.1
_ROUGH = 1e6
"""Friction of the soft body: that of a pair is 2ab/(a + b), so that half of what is wanted at the others gives it."""


def record(world: World, motion: Motion, name: str | None = None) -> MeshSequence:
    """Simulate one episode.

    Args:
        world: What is true.
        motion: What the tool does.
        name: Name of the episode; the world's and the motion's without.

    Raises:
        PlopError: Drake is not installed, or knows no such law.
    """
    one_of(world.law, tuple(LAWS), "elastic law of Drake", where="world.law")
    tool, mesh = tool_motion(world, motion), tetrahedral_mesh(world)
    simulated = _simulated(world, mesh, tool)
    return as_sequence(world, motion, tool, mesh, simulated, "Drake", name or f"{world.name}_{motion.kind}")


def _simulated(world: World, mesh: TetrahedralMesh, tool: ToolMotion) -> Simulated:
    analysis = needed("pydrake.systems.analysis")
    with tempfile.TemporaryDirectory() as folder:
        diagram, plant, body, moved = _built(world, mesh, tool, Path(folder))
        simulator = analysis.Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    fem, contact = plant.deformable_model(), plant.get_generalized_contact_forces_output_port(moved)
    frames, forces = [], []
    for k, frame_s in enumerate(tool.times):
        start_s = -SETTLE_S if k == 0 else float(tool.times[k - 1])
        count = max(1, round((frame_s - start_s) / world.time_step_s))
        step = (frame_s - start_s) / count
        pushed = np.zeros((count, 3))
        for number, step_s in enumerate(start_s + step * np.arange(count)):
            pose, velocity, _ = tool.at(np.array([step_s]))
            plant.SetPositions(context, moved, pose[0, :3, 3])
            plant.SetVelocities(context, moved, velocity[0])
            simulator.AdvanceTo(simulator.get_context().get_time() + world.time_step_s)
            pushed[number] = -contact.Eval(context)
        frames.append(fem.GetPositions(context, body).T.copy())
        forces.append(pushed.mean(0))
    return Simulated(np.stack(frames), np.stack(forces))


def _built(world: World, mesh: TetrahedralMesh, tool: ToolMotion, folder: Path) -> tuple[Any, Any, Any, Any]:
    """Diagram, plant, the soft body's number and the tool's model."""
    framework, plants = needed("pydrake.systems.framework"), needed("pydrake.multibody.plant")
    geometry = needed("pydrake.geometry")
    builder = framework.DiagramBuilder()
    plant, graph = plants.AddMultibodyPlantSceneGraph(builder, world.time_step_s)
    plant.set_discrete_contact_approximation(plants.DiscreteContactApproximation.kLagged)
    plant.mutable_gravity_field().set_gravity_vector(world.gravity_m_s2)
    slab, below = geometry.Box(1.0, 1.0, _TABLE_M), [0, 0, -_TABLE_M / 2]
    _collides(plant, plant.world_body(), slab, world, world.table_friction, below, _TABLE_M / 2, "table")
    body = _soft_body(plant, world, mesh, folder)
    moved = _tool(plant, world, tool, folder)
    plant.Finalize()
    return builder.Build(), plant, body, moved


def _collides(
    plant: Any, body: Any, shape: Any, world: World, friction: float, place: list[float], depth_m: float, name: str
) -> None:
    """Give a rigid body a shape that soft bodies touch; `depth_m` is how far its middle lies below the face [m]."""
    geometry, maths, plants = needed("pydrake.geometry"), needed("pydrake.math"), needed("pydrake.multibody.plant")
    properties = geometry.ProximityProperties()
    geometry.AddCompliantHydroelasticProperties(0.01, world.contact_pa_m * depth_m, properties)
    geometry.AddContactMaterial(friction=plants.CoulombFriction(friction / 2, friction / 2), properties=properties)
    plant.RegisterCollisionGeometry(body, maths.RigidTransform(place), shape, name, properties)


def _soft_body(plant: Any, world: World, mesh: TetrahedralMesh, folder: Path) -> Any:
    geometry, fem, maths = needed("pydrake.geometry"), needed("pydrake.multibody.fem"), needed("pydrake.math")
    plants = needed("pydrake.multibody.plant")
    path = folder / "object.vtk"
    path.write_text(_vtk(mesh), encoding="ascii")
    config = fem.DeformableBodyConfig()
    config.set_youngs_modulus(world.youngs_modulus_pa)
    config.set_poissons_ratio(world.poisson)
    config.set_mass_density(world.density_kg_m3)
    config.set_mass_damping_coefficient(world.damping_per_s)
    config.set_stiffness_damping_coefficient(world.stiffness_damping_s)
    config.set_material_model(getattr(fem.MaterialModel, LAWS[world.law]))
    instance = geometry.GeometryInstance(maths.RigidTransform(), geometry.Mesh(str(path)), "object")
    properties = geometry.ProximityProperties()
    geometry.AddContactMaterial(friction=plants.CoulombFriction(_ROUGH, _ROUGH), properties=properties)
    instance.set_proximity_properties(properties)
    return plant.mutable_deformable_model().RegisterDeformableBody(instance, config, 1.0)


def _tool(plant: Any, world: World, tool: ToolMotion, folder: Path) -> Any:
    """Add the tool on three sliding joints along the world's axes, turned as its motion is."""
    tree, geometry = needed("pydrake.multibody.tree"), needed("pydrake.geometry")
    instance = plant.AddModelInstance("tool")
    inertia = tree.SpatialInertia.SolidBoxWithMass(_TOOL_KG, 1.0, 1.0, 1.0)
    parent = plant.world_body()
    for number, axis in enumerate(np.eye(3)):
        child = plant.AddRigidBody(f"tool_{number}", instance, inertia if number == 2 else tree.SpatialInertia.Zero())
        joint = tree.PrismaticJoint(f"slide_{number}", parent.body_frame(), child.body_frame(), axis)
        plant.AddJoint(joint)
        parent = child
    plant.set_gravity_enabled(instance, False)
    path = folder / "tool.obj"
    turned = tool.vertices @ tool.world_from_tool[0, :3, :3].T
    path.write_text(_obj(turned, tool.faces), encoding="ascii")
    depth_m = float(np.ptp(turned[:, 2])) / 2
    _collides(plant, parent, geometry.Convex(str(path)), world, world.tool_friction, [0, 0, 0], depth_m, "tool")
    return instance


def _obj(vertices: np.ndarray, faces: np.ndarray) -> str:
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join(rows) + "\n"


def _vtk(mesh: TetrahedralMesh) -> str:
    """Legacy VTK text of a tetrahedral mesh."""
    rows = [
        "# vtk DataFile Version 3.0",
        "object",
        "ASCII",
        "DATASET UNSTRUCTURED_GRID",
        f"POINTS {len(mesh.nodes)} double",
    ]
    rows += [f"{x:.12g} {y:.12g} {z:.12g}" for x, y, z in mesh.nodes]
    count = len(mesh.tetrahedra)
    rows += [f"CELLS {count} {5 * count}", *(f"4 {a} {b} {c} {d}" for a, b, c, d in mesh.tetrahedra)]
    return "\n".join([*rows, f"CELL_TYPES {count}", *["10"] * count]) + "\n"
