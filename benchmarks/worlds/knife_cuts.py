"""What DiSECt simulates: a soft object on a table, cut in two by a knife that then pushes one part aside.

Needs no simulator. Lengths are in metres, in plop's world: z up, table at z = 0, the object around the origin.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.worlds.clipping import Clipped, clipped, thickness_m, upper_half
from benchmarks.worlds.scene import TetrahedralMesh, tetrahedral_mesh
from benchmarks.worlds.scene import World as Scene
from plop.errors import PlopError
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.motions import led_along
from plop.physics.scenes.names import one_of
from plop.physics.scenes.shapes import Shape
from plop.recordings.readers.declared_units import WORLD_FROM_UP

FRAME_S = 0.05
TIME_STEP_S = 1e-4
"""Longest time step."""
SIZE_M, CELLS_M = 0.1, 0.01
GAP_M, BELOW_M, PUSH_S = 0.005, 0.008, 0.3
"""The edge starts so far above the object, ends so far below the table; the push that follows lasts so long."""
SHAPES = {"prism": "block", "cylinder": "cylinder", "sphere": "sphere"}
"""Upper half of each: 100 x 100 x 50 mm, half a cylinder that lies along y, half a ball."""


@dataclass(frozen=True)
class World:
    """Declared truth of one object, its table and its knife."""

    shape: str = "prism"
    material: str = "jelly"
    youngs_modulus_pa: float = 1e4
    poisson: float = 0.47
    density_kg_m3: float = 1150.0
    viscosity_pa_s: float = 6.0
    """The simulator's `damping`: stress over rate of strain [Pa s]."""
    table_n_m: float = 3000.0
    """Stiffness of the table for each node [N/m]."""
    table_friction: float = 0.5
    knife_n_m: float = 600.0
    """Stiffness of the knife for each spring across the cut: `sdf_ke` [N/m]."""
    knife_friction: float = 0.5
    spring_n_m: float = 250.0
    """Stiffness of a whole spring across the cut [N/m]."""
    spring_softness: float = 36000.0
    """Stiffness that a spring at the knife loses, for each metre that it is stretched, in TIME_STEP_S [N/m / m]."""
    tilt_x_deg: float = 0.0
    """Tilt of the table: gravity leans so far towards +x [deg]."""
    tilt_y_deg: float = 0.0
    swelling_per_s: float = 0.0
    """Rate at which the stress-free volume grows, of itself [1/s]."""

    @property
    def name(self) -> str:
        """Name of the environment."""
        return f"{self.shape}-{self.material}"

    @property
    def wave_m_s(self) -> float:
        """Speed of a compression wave [m/s]."""
        shares = (1 - self.poisson) / ((1 + self.poisson) * (1 - 2 * self.poisson))
        return float(np.sqrt(self.youngs_modulus_pa * shares / self.density_kg_m3))

    @property
    def gravity_m_s2(self) -> np.ndarray:
        """Acceleration of free fall in the table's frame, [3] [m/s^2]."""
        return Scene(tilt_deg=(self.tilt_x_deg, self.tilt_y_deg)).gravity_m_s2


MATERIALS = {
    "jelly": World(),
    "polymer": World(
        material="polymer",
        youngs_modulus_pa=5e5,
        poisson=0.40,
        density_kg_m3=1100.0,
        viscosity_pa_s=10.0,
        table_n_m=5000.0,
        knife_n_m=4000.0,
        spring_n_m=2500.0,
        spring_softness=120000.0,
    ),
    "foam": World(
        material="foam",
        youngs_modulus_pa=3e4,
        poisson=0.15,
        density_kg_m3=150.0,
        viscosity_pa_s=2.0,
        table_n_m=500.0,
        spring_n_m=300.0,
        spring_softness=44000.0,
    ),
}
HIDEABLE = {
    "stiffness": ("youngs_modulus_pa", True),
    "density": ("density_kg_m3", True),
    "damping": ("viscosity_pa_s", True),
    "table_friction": ("table_friction", False),
    "knife_friction": ("knife_friction", False),
    "cutting_stiffness": ("knife_n_m", True),
    "cutting_softness": ("spring_softness", True),
    "tilt_x_deg": ("tilt_x_deg", False),
    "tilt_y_deg": ("tilt_y_deg", False),
    "swelling": ("swelling_per_s", False),
}
"""What can be hidden: the number of the world, and whether it is multiplied (or replaced)."""
SIGNED = ("tilt_x_deg", "tilt_y_deg", "swelling")
"""What may be negative."""


@dataclass(frozen=True)
class Motion:
    """What the knife does in one episode."""

    x_m: float = 0.0
    """Where it starts, from the middle [m]."""
    y_m: float = 0.0
    yaw_rad: float = 0.0
    """Turn about the vertical; at 0 the blade lies along y and its normal is x [rad]."""
    down_m_s: float = 0.06
    aside_m_s: float = 0.08
    """Speed of the push along the normal, signed [m/s]."""


def world_of(name: str) -> World:
    """Look an object up, such as "prism-jelly".

    Raises:
        PlopError: There is no such object.
    """
    names = [f"{shape}-{material}" for shape in SHAPES for material in MATERIALS]
    shape, _, material = one_of(name, names, "object", where="--object").partition("-")
    return replace(MATERIALS[material], shape=shape)


def hide(world: World, texts: Sequence[str]) -> World:
    """Change a world by texts such as "stiffness=1.5", one for each number.

    Raises:
        PlopError: A key is unknown, a text is no key=number, or a number is impossible.
    """
    for text in texts:
        key, _, value = text.partition("=")
        field, is_factor = HIDEABLE[one_of(key, HIDEABLE, "number that can be hidden", where=f"--hide {text}")]
        try:
            number = float(value)
        except ValueError:
            number = np.nan
        if not np.isfinite(number) or (number < 0 and key not in SIGNED) or (number == 0 and is_factor):
            expected = "a factor above 0" if is_factor else "a number" if key in SIGNED else "a number from 0"
            raise PlopError(
                "This is no number to hide.", where=f"--hide {text}", expected=expected, found=value or "none"
            )
        world = replace(world, **{field: getattr(world, field) * number if is_factor else number})
    return world


def drawn(seed: int, number: int) -> Motion:
    """Draw the motion of an episode; the part on the side of the knife is pushed outwards."""
    r = np.random.default_rng([seed, 11, number])
    x_m = float(r.uniform(-0.024, 0.024))
    return Motion(
        x_m=x_m,
        y_m=float(r.uniform(-0.008, 0.008)),
        yaw_rad=float(np.deg2rad(r.uniform(-25, 25))),
        down_m_s=float(r.uniform(0.04, 0.07)),
        aside_m_s=float(np.copysign(r.uniform(0.06, 0.09), x_m)),
    )


@functools.cache
def object_mesh(shape: str) -> TetrahedralMesh:
    """Cut an object of the simulator into tetrahedra, flat side on the table."""
    mesh = tetrahedral_mesh(Scene(shape=Shape(SHAPES[shape], (SIZE_M,) * 3), cells_m=CELLS_M))
    nodes = mesh.nodes - [0, 0, SIZE_M / 2]
    if shape == "cylinder":
        nodes = nodes @ WORLD_FROM_UP["y"].T
    return upper_half(replace(mesh, nodes=nodes))


def cut_of(shape: str, motion: Motion) -> Clipped:
    """Cut an object along the blade, at most 1.5 mm from where the motion asks for it, far from any node."""
    mesh, normal = object_mesh(shape), _normal(motion)
    along = mesh.nodes @ normal
    steps = np.arange(-30, 31) * 5e-5
    wanted = motion.x_m * normal[0] + motion.y_m * normal[1]
    clear = np.abs(along[:, None] - wanted - steps).min(0)
    return clipped(mesh, normal, wanted + steps[np.argmax(clear)])


def _normal(motion: Motion) -> np.ndarray:
    return np.array([np.cos(motion.yaw_rad), np.sin(motion.yaw_rad), 0.0])


def time_step_s(world: World) -> float:
    """Choose a stable time step; the same one whatever is hidden, up to twice the stiffness [s]."""
    plain = MATERIALS[world.material]
    speed_m_s = max(plain.wave_m_s, world.wave_m_s / 1.5)
    limit_s = min(TIME_STEP_S, 0.3 * thickness_m(object_mesh(world.shape)) / speed_m_s)
    return float(FRAME_S / np.ceil(FRAME_S / limit_s - 1e-9))


def tool_motion(vertices: np.ndarray, faces: np.ndarray, motion: Motion, cut: Clipped) -> ToolMotion:
    """Move the knife down through the object at its speed, then aside; corners of the way fall on frames.

    Args:
        vertices: Of the knife, [K, 3] in its frame [m].
        faces: [G, 3].
        motion: What the knife does.
        cut: Gives the plane of the blade.
    """
    way_m = np.ptp(cut.mesh.nodes[:, 2]) + GAP_M + BELOW_M
    down, push = int(np.ceil(way_m / motion.down_m_s / FRAME_S)), round(PUSH_S / FRAME_S)
    end = np.array([motion.x_m, motion.y_m, 0.0])
    end += (cut.offset_m - end @ cut.normal) * cut.normal
    end[2] = -BELOW_M - vertices[:, 2].min()
    start = end + [0, 0, down * FRAME_S * motion.down_m_s]
    points = np.stack([start, end, end + PUSH_S * motion.aside_m_s * cut.normal])
    times = np.arange(down + push + 1) * FRAME_S
    return ToolMotion(vertices, faces, times, led_along(times[[0, down, -1]], points, motion.yaw_rad, times))
