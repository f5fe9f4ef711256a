"""MuJoCo as a foreign world: flexes (linear tetrahedra, Saint Venant-Kirchhoff) with soft contact.

`pip install -e '.[worlds]'`. The tool is a body too heavy to be moved, whose place and velocity are set in every step.
Source: the chapter on deformable objects of MuJoCo's documentation; Todorov, Convex and analytically-invertible
dynamics with contacts and constraints (ICRA 2014).
"""

from __future__ import annotations

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
    node_volumes,
    tetrahedral_mesh,
    tool_motion,
)
from plop.physics.engine.tool_motion import ToolMotion
from plop.recordings.readers.mesh.sequence import MeshSequence

_TOOL_KG = 1e4


def record(world: World, motion: Motion, name: str | None = None) -> MeshSequence:
    """Simulate one episode; `world.law` is not used, the law is Saint Venant and Kirchhoff's.

    Raises:
        PlopError: MuJoCo is not installed.
    """
    tool, mesh = tool_motion(world, motion), tetrahedral_mesh(world)
    simulated = _simulated(world, mesh, tool)
    return as_sequence(world, motion, tool, mesh, simulated, "MuJoCo", name or f"{world.name}_{motion.kind}")


def _simulated(world: World, mesh: TetrahedralMesh, tool: ToolMotion) -> Simulated:
    mujoco = needed("mujoco")
    model = _model(mujoco, world, mesh, tool)
    data = mujoco.MjData(model)
    frames, forces = [], []
    for k, frame_s in enumerate(tool.times):
        start_s = -SETTLE_S if k == 0 else float(tool.times[k - 1])
        count = max(1, int(np.ceil((frame_s - start_s) / model.opt.timestep - 1e-6)))
        model.opt.timestep = (frame_s - start_s) / count
        poses, velocities, _ = tool.at(start_s + model.opt.timestep * np.arange(count))
        pushed = np.zeros((count, 3))
        for step, (pose, velocity) in enumerate(zip(poses, velocities, strict=True)):
            data.qpos[:3], data.qvel[:3] = pose[:3, 3], velocity
            mujoco.mj_step(model, data)
            pushed[step] = -data.qfrc_constraint[:3]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_flex(model, data)
        frames.append(data.flexvert_xpos.copy())
        forces.append(pushed.mean(0))
    return Simulated(np.stack(frames), np.stack(forces))


def _model(mujoco: Any, world: World, mesh: TetrahedralMesh, tool: ToolMotion) -> Any:
    model = mujoco.MjModel.from_xml_string(_xml(world, mesh, tool))
    mass = world.density_kg_m3 * node_volumes(mesh)
    bodies = model.flex_vertbodyid
    # a flex shares its mass out evenly; nodes on the surface stand for less
    model.body_mass[bodies] = mass
    model.body_inertia[bodies] = 1e-9
    for body, kilograms in zip(bodies, mass, strict=True):
        first = model.body_dofadr[body]
        model.dof_damping[first : first + 3] = world.damping_per_s * kilograms
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _xml(world: World, mesh: TetrahedralMesh, tool: ToolMotion) -> str:
    """Write the model: table, tool on three sliding joints, and the soft body."""
    turned = tool.vertices @ tool.world_from_tool[0, :3, :3].T
    contact = f'solref="{world.contact_time_s} 1" solimp="0.95 0.99 0.0005" condim="3"'
    slides = "".join(
        f'<joint type="slide" axis="{axis}" name="slide_{k}"/>' for k, axis in enumerate(("1 0 0", "0 1 0", "0 0 1"))
    )
    return f"""
<mujoco>
  <compiler autolimits="true"/>
  <option timestep="{world.time_step_s}" gravity="{_row(world.gravity_m_s2)}" cone="elliptic"
          impratio="20" solver="CG" tolerance="1e-9" iterations="80" integrator="discrete"/>
  <asset><mesh name="tool" vertex="{_row(turned)}"/></asset>
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1" friction="{world.table_friction} 0 0" {contact}/>
    <body name="tool" gravcomp="1">
      {slides}<inertial pos="0 0 0" mass="{_TOOL_KG}" diaginertia="1e4 1e4 1e4"/>
      <geom type="mesh" mesh="tool" friction="{world.tool_friction} 0 0" {contact}/>
    </body>
    <flexcomp name="object" type="direct" dim="3" mass="1" radius="0.0001" dof="full"
              point="{_row(mesh.nodes)}" element="{_row(mesh.tetrahedra)}">
      <elasticity young="{world.youngs_modulus_pa}" poisson="{world.poisson}" damping="{world.stiffness_damping_s}"/>
      <contact selfcollide="none" friction="0 0 0" {contact}/>
    </flexcomp>
  </worldbody>
</mujoco>"""


def _row(values: np.ndarray) -> str:
    return " ".join(f"{value:.10g}" for value in np.ravel(values))
