"""The engine's running state: particles sorted along x, the tool and the table, one time step after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from plop.physics.engine import law
from plop.physics.engine.background_grid import BackgroundGrid
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.kernels.step import advance, touch
from plop.physics.engine.law import Hook, Law
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.surface_normals import outward_normals
from plop.physics.engine.time_step import comparable_step_s, highest_speed_m_s, run_step_s
from plop.physics.engine.tool_motion import ToolKind, ToolMotion, kernel_poses
from plop.physics.engine.tracers import Tracers

_MAX_NODES = 30_000_000
_PER_PARTICLE = ("x", "v", "c", "f", "side", "fixed", "cut", "number", "mass", "volume", "radius", "held", "outward")


class UnstableStepError(Exception):
    """A step in which a particle ran away; carries the reason and, where one is to blame, the effect's name."""

    def __init__(self, reason: str, effect: str | None = None) -> None:
        super().__init__(reason)
        self.effect = effect


class Engine:
    """Particles and grid of one run; `plop.physics.engine.solver.simulate` is the way in."""

    def __init__(
        self,
        particles: Particles,
        material: Material,
        tool: ToolMotion | None,
        config: EngineConfig,
        effects: Sequence[Law] = (),
        most_step_s: float = np.inf,
        step_ratio: float = 1.0,
    ) -> None:
        self.effects = [effect for effect in effects if not effect.absent]
        for effect in self.effects:
            material, config = law.changed(effect, "material", material), law.changed(effect, "config", config)
        self.material, self.tool, self.config = material, tool, config
        self._take(particles)
        self.mass = (self.volume * material.density_kg_m3).astype(np.float32)
        self.memory = self._memories(particles)
        self.pose, self.impulse = np.zeros((6, 3), np.float32), np.zeros((2, 3))
        self._hooks = {hook: [effect for effect in self.effects if effect.overrides(hook)] for hook in get_args(Hook)}
        self.extra = np.zeros((len(self.x) if self._hooks["stress"] else 0, 6), np.float32)
        self.steps, self.halvings = 0, 0
        self._travelled = np.inf
        self._grid = BackgroundGrid(config.dx_m, config.table_z_m, config.chunks)
        self._constants()
        limits = {repr(effect): law.slowest_step_s(effect, material, config) for effect in self.effects}
        speed = highest_speed_m_s(self.v, self.tool)
        stable_s = run_step_s(material, config, speed, limits, len(self.x))
        self._base_step_s = comparable_step_s(stable_s, most_step_s, step_ratio)

    def _take(self, particles: Particles) -> None:
        """Copy a state: particles with volume into the engine's own arrays, those without as tracers."""
        count, volume = len(particles), np.asarray(particles.volumes, np.float32)
        sides = np.zeros(count) if particles.sides is None else np.asarray(particles.sides)
        passed = np.zeros(count, bool) if particles.passed is None else np.asarray(particles.passed, bool)
        state = (
            np.asarray(particles.positions, np.float32),
            _given(particles.velocities, np.zeros((count, 3))),
            _given(particles.affine, np.zeros((count, 3, 3))),
            _given(particles.F, np.tile(np.eye(3), (count, 1, 1))),
            (sides < 0).astype(np.int64),
            sides != 0,
            passed,
            np.arange(count),
        )
        own = volume > 0
        self.x, self.v, self.c, self.f, self.side, self.fixed, self.cut, self.number = (part[own] for part in state)
        self.tracers = Tracers(*(part[~own] for part in state))
        self.volume = volume[own]
        self.radius = _given(particles.radii, 0.5 * np.cbrt(volume))[own]
        self.held = _given(particles.held, np.zeros((count, 3)))[own]
        if particles.outward is None:
            self.outward = outward_normals(self.x, self.f, self.volume)
        else:
            self.outward = np.asarray(particles.outward, np.float32)[own]

    def _memories(self, particles: Particles) -> dict[str, np.ndarray]:
        """What effects remember of each particle: as given, else their first values."""
        given, found = particles.memory or {}, {}
        for effect in self.effects:
            for name, (shape, first) in effect.remembers.items():
                key = f"{effect.name}.{name}"
                found[key] = _given(given.get(key), np.full((len(particles), *shape), first))[self.number]
        return found

    def _constants(self) -> None:
        """Hold what the kernels need in their own number type."""
        material, config, tool = self.material, self.config, self.tool
        self._shape = None if tool is None else tool.shape
        self._kind = int(ToolKind.NONE if self._shape is None else self._shape.kind)
        self._faces = np.zeros((1, 4), np.float32) if self._shape is None else self._shape.faces
        self._thickness = np.zeros(4, np.float32) if self._shape is None else self._shape.thickness
        cuts = self._shape is not None and self._kind == ToolKind.BLADE and material.toughness_j_m2 > 0
        self._edges = self._shape.edges if self._shape is not None and cuts else np.zeros((0, 3), np.float32)
        self._toughness, self._pyramid = np.float32(material.toughness_j_m2), config.table_cone == "pyramid"
        self._elastic = (
            int(material.law),
            np.float32(material.shear_pa),
            np.float32(material.lame_pa),
            np.float32(material.viscosity_pa_s),
        )
        self._friction = np.array(
            [material.table_friction, material.tool_friction, material.cut_friction, material.table_slip_m_s],
            np.float32,
        )
        self._gravity = np.array(config.gravity_m_s2, np.float32)
        table = -np.inf if config.table_z_m is None else config.table_z_m + 1e-6
        self._table, self._density = np.float32(table), np.float32(material.density_kg_m3)
        self._modulus = np.float32(material.lame_pa + 2 * material.shear_pa)

    @property
    def elastic(self) -> tuple[int, np.float32, np.float32]:
        """Number of the elastic law and Lame's mu and lambda [Pa], as the kernels take them."""
        return self._elastic[:3]

    @property
    def tool_now(self) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Kind, pose, faces and thickness of the tool in this time step, as the kernels take them."""
        return self._kind, self.pose, self._faces, self._thickness

    @property
    def longest_step_s(self) -> float:
        """Longest time step taken [s]."""
        return float(self._base_step_s / 2**self.halvings)

    def save(self) -> dict[str, Any]:
        """Copy what `advance` changes."""
        memory = {key: value.copy() for key, value in self.memory.items()}
        return {name: getattr(self, name).copy() for name in _PER_PARTICLE} | {
            "memory": memory,
            "tracers": self.tracers.save(),
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to a saved state."""
        for name in _PER_PARTICLE:
            setattr(self, name, saved[name].copy())
        self.memory = {key: value.copy() for key, value in saved["memory"].items()}
        self.tracers.restore(saved["tracers"])
        self._travelled = np.inf

    def advance(self, start_s: float, end_s: float) -> np.ndarray:
        """Advance from one time to the next in equal steps.

        Returns:
            Mean force on the object from table and tool, shape [2, 3] [N].

        Raises:
            UnstableStepError: A particle moved too far, lost its volume or is no number any more.
        """
        count = max(1, int(np.ceil((end_s - start_s) / self.longest_step_s - 1e-6)))
        dt = (end_s - start_s) / count
        poses = np.zeros((count, 6, 3), np.float32)
        if self.tool is not None and self._shape is not None:
            poses = kernel_poses(self._shape, self.tool, start_s + dt * (np.arange(count) + 0.5))
        impulse = np.zeros((2, 3))
        for pose in poses:
            impulse += self._step(pose, dt)
        return impulse / (end_s - start_s)

    def _step(self, pose: np.ndarray, dt: float) -> np.ndarray:
        if self._travelled > 0.9 * self.config.dx_m:
            self._place_grid()
        self.pose, self.impulse = pose, np.zeros((2, 3))
        step = np.float32(dt)
        self._touch(step)
        self._act("before", dt)
        if self._hooks["stress"]:
            self.extra[:] = 0
            self._act("stress", dt)
        fastest, smallest = self._move(step, np.float32(np.exp(-self.material.damping_per_s * dt)))
        self._act("after", dt)
        self.steps += 1
        self._check(fastest, smallest, dt)
        return self.impulse

    def _touch(self, step: np.float32) -> None:
        """Let the tool cut and push particles."""
        if self._kind == ToolKind.NONE:
            return
        grid = self._grid
        pushed = (self.x, self.v, self.mass, self.radius, self.side, self.cut, self.held, self.outward, self.f)
        band = np.float32(self.config.band_cells * grid.dx)
        elastic = (self._friction[1], self._modulus, self._density)
        sides = (self.fixed, grid.bounds, self.tracers.to_mark)
        touch(pushed, *sides, self.tool_now, band, *elastic, grid.dx, step, grid.pushes, self.impulse[1])

    def _move(self, step: np.float32, decay: np.float32) -> tuple[float, float]:
        """Transfer to the grid, advance its velocities, and transfer back; see `kernels.step.advance`."""
        grid = self._grid
        moving = (self.x, self.v, self.c, self.f)
        body = (*moving, self.mass, self.volume, self.side, self.cut, self.radius, grid.bounds, grid.planes)
        chunks = (grid.chunk_nodes, grid.chunk_passed, grid.report, self.tracers.report)
        nodes = (grid.nodes, grid.passed, grid.gaps, grid.velocity, grid.impulses)
        elastic = (*self._elastic, self.extra)
        edges = (self.pose, self._edges, self._toughness)
        given = (edges, (self._table, self._pyramid), self._friction, self._gravity, self._density, self.impulse)
        frame = (*grid.frame, grid.dx)
        fastest, smallest = advance(body, self.tracers.to_move, frame, elastic, step, decay, chunks, nodes, *given)
        return float(fastest), float(smallest)

    def _act(self, hook: Hook, dt: float) -> None:
        for effect in self._hooks[hook]:
            trouble = law.act(effect, hook, self, dt)
            if trouble is not None:
                raise UnstableStepError(trouble, effect.name)

    def _check(self, fastest: float, smallest: float, dt: float) -> None:
        if not np.isfinite(fastest):
            raise UnstableStepError("a speed that is not a number")
        moved = float(np.sqrt(fastest)) * dt
        if moved > 0.5 * self.config.dx_m:
            raise UnstableStepError(f"{np.sqrt(fastest):.3g} m/s, {moved / self.config.dx_m:.2g} cells in one step")
        if smallest <= 0:
            raise UnstableStepError("a particle that turned inside out")
        self._travelled += moved

    def _place_grid(self) -> None:
        """Lay the grid around the particles, and sort them along x."""
        ends = np.concatenate([[self.x.min(0), self.x.max(0)], self.tracers.x])
        self._grid.lay(ends.min(0), ends.max(0))
        if self._grid.size > _MAX_NODES:
            raise UnstableStepError(f"particles spread over {self._grid.size / 1e6:.0f} million cells")
        order, column = self._grid.cell_order(self.x)
        self.tracers.sort(self._grid.cell_order(self.tracers.x)[0], self.config.chunks)
        for name in _PER_PARTICLE:
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[order]))
        self.memory = {key: np.ascontiguousarray(value[order]) for key, value in self.memory.items()}
        self._grid.divide(column)
        self._travelled = 0.0

    def snapshot(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Copy positions, deformation gradients and signed sides in the caller's order."""
        side, cut = self._whole("side"), self._whole("cut")
        return self._whole("x"), self._whole("f"), np.where(cut, 1 - 2 * side, 0).astype(np.int8)

    def state(self) -> Particles:
        """Copy the whole state in the caller's order; a run can go on from it."""
        cut = self._whole("cut")
        sides = np.where(cut | self._whole("fixed"), 1 - 2 * self._whole("side"), 0)
        own = self.volume, self.radius, self.held, self.outward
        volume, radius, held, outward = (self._scattered(values) for values in own)
        memory = {key: self._scattered(value) for key, value in self.memory.items()}
        x, v, f, c = (self._whole(name) for name in "xvfc")
        return Particles(x, volume, v, f, sides, radius, c, cut, memory, held, outward)

    def _whole(self, name: str) -> np.ndarray:
        """One array of particles and tracers, in the caller's order."""
        whole = self._scattered(getattr(self, name))
        whole[self.tracers.number] = getattr(self.tracers, name)
        return whole

    def _scattered(self, values: np.ndarray) -> np.ndarray:
        """An array of the particles in the caller's order; 0 for tracers."""
        whole = np.zeros((len(self.number) + len(self.tracers), *values.shape[1:]), values.dtype)
        whole[self.number] = values
        return whole


def _given(values: np.ndarray | None, otherwise: np.ndarray) -> np.ndarray:
    return np.array(otherwise if values is None else values, np.float32)
