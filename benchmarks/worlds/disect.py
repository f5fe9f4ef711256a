"""DiSECt as a foreign world: a knife cuts a soft object on a table in two and then pushes one part aside.

`python -m benchmarks.worlds.disect --simulator FOLDER --out RAW --object prism-jelly`. FOLDER is a clone of
github.com/NVlabs/DiSECt: its licence allows research only, so nothing of it is here. It needs `munch`, `tqdm` and
`ninja`, which builds its kernels on the first run, and Python 3.11; its C++ mesh cutter (`meshing/`) is used where it
is installed.

Source: Heiden, Macklin, Narang, Fox, Garg & Ramos, DiSECt: A Differentiable Simulation Engine for Autonomous Robotic
Cutting (RSS 2021).
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import copy
import functools
import importlib
import importlib.util
import io
import json
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.worlds.clipping import Clipped
from benchmarks.worlds.disect_import import load
from benchmarks.worlds.knife_cuts import (
    FRAME_S,
    HIDEABLE,
    PUSH_S,
    TIME_STEP_S,
    Motion,
    World,
    cut_of,
    drawn,
    hide,
    time_step_s,
    tool_motion,
    world_of,
)
from plop.errors import PlopError
from plop.physics.engine.tool_motion import ToolMotion
from plop.recordings.readers.declared_units import WORLD_FROM_UP
from plop.recordings.readers.mesh.sequence import MeshSequence, write_mesh_sequence

SLIP_M_S = 0.01
"""About which speed the friction of the knife sets in: `sdf_kf`."""
_PYTHON_CUTTER = {"OrderedDict": collections.OrderedDict, "defaultdict": collections.defaultdict, "sys": sys}
_WORLD_FROM_SIMULATOR = WORLD_FROM_UP["y"]


def record(simulator: Path, world: World, motion: Motion, name: str | None = None) -> MeshSequence:
    """Simulate one episode.

    Args:
        simulator: Clone of DiSECt.
        world: What is true.
        motion: What the knife does.
        name: Name of the episode; the world's without.

    Raises:
        PlopError: The simulator is not there, lacks a package, or did not cut along the plane.
    """
    load(simulator)
    cut = cut_of(world.shape, motion)
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        sim, tool = _prepared(world, motion, cut, folder)
        ends, weights = _followed(sim.builder, cut)
        nodes, forces, left = _simulated(sim, tool, world)
    first, second = nodes[:, ends[:, 0]], nodes[:, ends[:, 1]]
    vertices = first * (1 - weights[:, None]) + second * weights[:, None]
    return MeshSequence(
        name=name or world.name,
        environment=world.name,
        times=tool.times,
        vertices=vertices,
        faces=cut.faces,
        tool_vertices=tool.vertices,
        tool_faces=tool.faces,
        world_from_tool=tool.world_from_tool,
        rest_vertices=cut.vertices,
        cut_faces=cut.cut_faces,
        source="DiSECt",
        facts={
            "world": asdict(world),
            "motion": asdict(motion),
            "simulator": "DiSECt",
            "time_step_s": sim.sim_dt,
            "cut_offset_m": cut.offset_m,
            "springs_left": left,
            "caught_points": caught(cut, vertices[-1], tool.world_from_tool[-1, :3, 3]),
            "tool_force_n": forces.tolist(),
        },
    )


def _prepared(world: World, motion: Motion, cut: Clipped, folder: str) -> tuple[Any, ToolMotion]:
    """Build the simulator's scene with its cut mesh; gives the tool as plop sees it."""
    cutting = importlib.import_module("cutting.cutting_sim")
    nodes = cut.mesh.nodes @ _WORLD_FROM_SIMULATOR
    cutting.load_mesh = lambda _: (cut.mesh.tetrahedra.ravel(), nodes.copy())
    sim = cutting.CuttingSim(_settings(world, motion), adapter="cpu", requires_grad=False, log_folder=folder)
    vertices, faces = sim.knife.create_mesh()
    tool = tool_motion(vertices @ _WORLD_FROM_SIMULATOR.T, faces.reshape(-1, 3), motion, cut)
    start, after = tool.world_from_tool[:2, :3, 3] @ _WORLD_FROM_SIMULATOR
    sim.sim_duration = float(tool.times[-1]) - PUSH_S
    sim.motion = cutting.ConstantLinearVelocityMotion(
        start, (after - start) / FRAME_S, np.array(sim.settings.knife_motion.quaternion), device="cpu"
    )
    if importlib.util.find_spec("meshcutter") is None:
        python_cutter = importlib.import_module("dflex.model")  # uses four names that it does not import
        vars(python_cutter).update(MeshTopology=cutting.MeshTopology, **_PYTHON_CUTTER)
        sim.builder.prepare_cut = functools.partial(sim.builder.prepare_cut, use_cpp=False)
    sim.cut()
    sim.model.gravity[:] = sim.model.gravity.new_tensor(world.gravity_m_s2 @ _WORLD_FROM_SIMULATOR)
    return sim, tool


def _settings(world: World, motion: Motion) -> Any:
    """Settings of the simulator, from its defaults."""
    settings = copy.deepcopy(importlib.import_module("cutting.settings").default_settings)
    step_s = time_step_s(world)
    settings.update(
        generator="meshio",
        sim_dt=step_s,
        young=world.youngs_modulus_pa,
        poisson=world.poisson,
        density=world.density_kg_m3,
        damping=world.viscosity_pa_s,
        ground_ke=world.table_n_m,
        ground_kd=0.0,
        ground_kf=world.table_n_m,
        ground_mu=world.table_friction,
        sdf_radius=0.0,
    )
    for part in ("", "surface_"):
        settings.update(
            {
                f"{part}sdf_ke": world.knife_n_m,
                f"{part}sdf_kd": 1.0,
                f"{part}sdf_kf": SLIP_M_S,
                f"{part}sdf_mu": world.knife_friction,
                f"{part}cut_spring_ke": world.spring_n_m,
                f"{part}cut_spring_kd": 0.0,
                f"{part}cut_spring_softness": world.spring_softness * step_s / TIME_STEP_S,
            }
        )
    settings.geometry.position = (0.0, 0.0, 0.0)
    settings.static_vertices.include, settings.static_vertices.exclude = [], []
    settings.knife_motion.rotation = [0.0, 1.0, 0.0, motion.yaw_rad]
    settings.knife_motion.quaternion = [0.0, np.sin(motion.yaw_rad / 2), 0.0, np.cos(motion.yaw_rad / 2)]
    return settings


def _followed(builder: Any, cut: Clipped) -> tuple[np.ndarray, np.ndarray]:
    """Find the simulator's nodes and weights of each vertex: nodes [V, 2], share of the second [V].

    Beyond the cut a part has virtual nodes, copies of those of the other part.
    """
    original = {copied: node for node, copied in builder.cut_duplicated_x.items()}
    found = {(n, n): (n, n, 0.0) for n in range(len(cut.mesh.nodes))}
    for (i, j), t in zip(np.asarray(builder.cut_edge_indices).tolist(), builder.cut_edge_coords, strict=True):
        inner, outer = original.get(i, i), original.get(j, j)
        found[(outer, inner) if i in original else (inner, outer)] = (i, j, float(t))
    try:
        rows = np.array([found[corner] for corner in map(tuple, cut.corners.tolist())])
    except KeyError as error:
        raise PlopError(
            "The simulator did not cut along the plane.",
            where="cut",
            expected="a point on every edge that crosses the plane",
            found=f"none between nodes {error}",
            fix="Move the cut: other numbers of the motion.",
        ) from error
    return rows[:, :2].astype(int), rows[:, 2]


def _simulated(sim: Any, tool: ToolMotion, world: World) -> tuple[np.ndarray, np.ndarray, int]:
    """Let the simulator run.

    Returns:
        Positions of all nodes, [T, N, 3] [m], the mean force of the knife on the object since the frame before,
        [T, 3] [N], and how many springs across the cut are not severed in the end.
    """
    torch = importlib.import_module("torch")
    model, state = sim.model, sim.model.state()
    nodes, forces = [state.particle_q.numpy().copy()], [np.zeros(3)]
    steps, grown = round(FRAME_S / sim.sim_dt), float(np.exp(-world.swelling_per_s * sim.sim_dt / 3))
    places = torch.tensor(tool.world_from_tool[:, :3, 3] @ _WORLD_FROM_SIMULATOR, dtype=torch.float32)
    state.joint_q[3:7] = torch.tensor(sim.settings.knife_motion.quaternion)
    with torch.no_grad():
        for here, there in zip(places, places[1:]):
            state.joint_q[:3], state.joint_qd[:3], state.joint_qd[3:] = here, (there - here) / FRAME_S, 0.0
            pushed = torch.zeros(3)
            for _ in range(steps):
                model.tet_poses *= grown  # inverse edges at rest: the stress-free lengths grow
                state = sim.integrator.forward(model, state, sim.sim_dt, update_mass_matrix=False)
                pushed += state.knife_f.sum(0)
            nodes.append(state.particle_q.numpy().copy())
            forces.append(pushed.numpy() / steps)
    left = int((state.cut_spring_ke > 0).sum())
    return np.stack(nodes) @ _WORLD_FROM_SIMULATOR.T, np.stack(forces) @ _WORLD_FROM_SIMULATOR.T, left


def caught(cut: Clipped, vertices: np.ndarray, place: np.ndarray) -> int:
    """Count points of the cut that lie beyond the middle of the knife: they drag the part that ought to stay.

    Args:
        cut: The cut.
        vertices: At the end, [V, 3] [m].
        place: Of the knife, [3] [m].
    """
    new = cut.corners[:, 0] != cut.corners[:, 1]
    height = (vertices[new] - place) @ cut.normal
    return int((np.where(cut.upper[new], -height, height) > 0).sum())


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.worlds.disect", description=__doc__)
    parser.add_argument("--simulator", type=Path, required=True, help="clone of NVlabs/DiSECt")
    parser.add_argument("--out", type=Path, required=True, help="folder for the raw recordings")
    parser.add_argument("--object", default="prism-jelly", help="prism, cylinder or sphere - jelly, polymer or foam")
    parser.add_argument("--episodes", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0, help="of the motions, whatever is hidden")
    parser.add_argument("--hide", nargs="*", default=[], metavar="KEY=NUMBER", help=", ".join(HIDEABLE))
    parser.add_argument("--jobs", type=int, default=1, help="episodes at a time, a process each")
    asked = parser.parse_args(words)
    world = hide(world_of(asked.object), asked.hide)
    load(asked.simulator)  # compiles once, before there are several
    todo = [k for k in range(asked.episodes) if not _there(asked.out, world, asked.seed, k)]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(asked.jobs, mp_context=spawn, max_tasks_per_child=1) as pool:
        for path in pool.map(functools.partial(_written, asked.simulator, asked.out, world, asked.seed), todo):
            print(path, flush=True)


def _name(world: World, number: int) -> str:
    return f"{world.name.replace('-', '_')}_{number:03d}"


def _there(out: Path, world: World, seed: int, number: int) -> bool:
    """Tell whether an episode is finished.

    Raises:
        PlopError: It is another one: with another motion, or with something else hidden.
    """
    path = out / f"{_name(world, number)}.json"
    if not path.is_file():
        return False
    found = json.loads(path.read_text())["facts"]
    wanted = {"world": asdict(world), "motion": asdict(drawn(seed, number))}
    other = [f"{key} {v}" for part, facts in wanted.items() for key, v in facts.items() if found[part].get(key) != v]
    if other:
        raise PlopError(
            "The folder holds an episode of another set.",
            where=path,
            expected=", ".join(other),
            found="other numbers",
            fix="Take one folder for each set: another --out.",
        )
    return True


def _written(simulator: Path, out: Path, world: World, seed: int, number: int) -> Path:
    return write_mesh_sequence(out, record(simulator, world, drawn(seed, number), _name(world, number)))


if __name__ == "__main__":
    try:
        main()
    except PlopError as error:
        sys.exit(f"error: {error}")
