"""Soft objects as lattices of particles: block, sphere, upright cylinder, whole or in two halves.

The halves meet in the plane of the later cut and are closed surfaces that coincide there before it.
Objects stand on the table z = 0 around the origin.

A round object is the image of a cube: the smooth map of a cube onto a ball (Nowell 2005), and for an
off-centre cut the translation of the hyperbolic plane in Klein's model, which preserves ball and
planes and moves the plane x = 0 to x = b.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.errors import PlopError
from plop.physics.engine.particles import Particles
from plop.physics.scenes.lattice import Lattice, lattice, surface_vertices
from plop.physics.scenes.names import one_of

SHAPES = ("block", "sphere", "cylinder")
_LEAST_M, _MOST_M = 0.005, 0.5


@dataclass(frozen=True)
class Shape:
    """A block, a sphere or an upright cylinder."""

    kind: str = "block"
    """block, sphere or cylinder."""
    size_m: tuple[float, float, float] = (0.080, 0.050, 0.040)
    """Length, width and height of the box around it [m]; all equal for a sphere, the first two for a cylinder."""

    def __post_init__(self) -> None:
        one_of(self.kind, SHAPES, "shape", where="shape.kind")
        if len(self.size_m) != 3:
            raise PlopError(
                "A shape's size must have three numbers.",
                where="shape.size_m",
                found=str(self.size_m),
                expected="length, width and height in metres",
                fix="Write for example size_m = [0.08, 0.05, 0.04].",
            )
        for value in self.size_m:
            if not _LEAST_M <= value <= _MOST_M:
                guess = (
                    f"Is the value in millimetres? Then write {value / 1000:g}."
                    if value > _MOST_M
                    else "Check the unit."
                )
                raise PlopError(
                    "The object has an implausible size.",
                    where="shape.size_m",
                    expected=f"{_LEAST_M:g} to {_MOST_M:g} m",
                    found=f"{value:g} m",
                    fix=guess,
                )
        equal = {"block": 1, "sphere": 3, "cylinder": 2}[self.kind]
        if len(set(self.size_m[:equal])) > 1:
            raise PlopError(
                f"The sizes are not those of a {self.kind}.",
                where="shape.size_m",
                found=str(self.size_m),
                expected=f"the first {equal} numbers equal",
                fix="Write radius_m (and height_m of a cylinder) instead of size_m.",
            )

    @property
    def height_m(self) -> float:
        """Height above the table [m]."""
        return self.size_m[2]

    def reach_m(self, direction: np.ndarray) -> float:
        """Distance from the middle to the farthest point along a horizontal unit vector [2] [m]."""
        half = np.asarray(self.size_m) / 2
        return float(np.abs(direction) @ half[:2]) if self.kind == "block" else float(half[0])


@dataclass(frozen=True)
class Body:
    """An object's particles and its closed surface."""

    particles: Particles
    surface: np.ndarray
    """Particles on the surface, [V]."""
    faces: np.ndarray
    """Triangles over the surface's vertices, outward, [F, 3]."""
    cut_faces: np.ndarray
    """Faces created by the cut, bool [F]."""


def whole_body(shape: Shape, spacing_m: float) -> Body:
    """Fill a shape with one lattice of particles about `spacing_m` [m] apart."""
    grid = lattice(lattice_counts(shape, shape.size_m[0], spacing_m))
    points = _placed(shape, grid.parameters * 2 - 1, 0.0, 0.0)
    return _body([grid], [points], [0])


def halved_body(shape: Shape, spacing_m: float, offset_m: float, yaw_rad: float) -> Body:
    """Fill the two sides of a later cut with a lattice each.

    Args:
        shape: The object.
        spacing_m: Distance of the particles [m].
        offset_m: Position of the cut on the object's x axis [m].
        yaw_rad: Turn of the blade about the vertical; at 0 its normal is x [rad].

    Raises:
        PlopError: The plane leaves a half less than two cells thick.
    """
    half = shape.size_m[0] / 2
    away = abs(offset_m) + (np.tan(abs(yaw_rad)) * shape.size_m[1] / 2 if shape.kind == "block" else 0.0)
    if half - away < 2 * spacing_m:
        raise PlopError(
            "The cut is outside the object.",
            where="motion.cut_offset_m, motion.yaw_deg",
            expected=f"a cut at most {half - 2 * spacing_m:.3g} m from the middle",
            found=f"{away:.3g} m",
            fix="Narrow these two ranges in the scene's [motion].",
        )
    grids, points, sides = [], [], []
    for sign in (-1, 1):
        grid = lattice(lattice_counts(shape, half - sign * offset_m, spacing_m))
        cube = grid.parameters * [1, 2, 2] + [-1 if sign < 0 else 0, -1, -1]
        grids.append(grid)
        points.append(_placed(shape, cube, offset_m, yaw_rad))
        sides.append(sign)
    return _body(grids, points, sides)


def lattice_counts(shape: Shape, length_m: float, spacing_m: float) -> tuple[int, int, int]:
    """Count the cells of a lattice along each axis for a shape of which `length_m` [m] lie along x."""
    # an even number of cells puts a node at the contact of a round object with the table
    step = 1 if shape.kind == "block" else 2
    first = max(2, round(length_m / spacing_m))
    across, up = (step * max(1, round(size / spacing_m / step)) for size in shape.size_m[1:])
    return first, max(2, across), max(2, up)


def _placed(shape: Shape, cube: np.ndarray, offset_m: float, yaw_rad: float) -> np.ndarray:
    """Map points of the cube [-1, 1]^3 onto the object, the plane x = 0 onto the cut; [N, 3] [m]."""
    half = np.asarray(shape.size_m) / 2
    if shape.kind == "block":
        x, y, z = cube.T
        plane = offset_m - np.tan(yaw_rad) * y * half[1]
        along = np.where(x < 0, plane + x * (plane + half[0]), plane + x * (half[0] - plane))
        return np.stack([along, y * half[1], (z + 1) * half[2]], 1)
    # the plane crosses the x axis at the offset: its distance from the middle is less
    shift = offset_m * np.cos(yaw_rad) / half[0]
    if shape.kind == "sphere":
        unit = _shifted(_ball_of_cube(cube), shift)
    else:
        flat = np.c_[cube[:, :2], np.zeros(len(cube))]
        unit = np.c_[_shifted(_ball_of_cube(flat)[:, :2], shift), cube[:, 2]]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = unit.T
    return np.stack([cos * x - sin * y, sin * x + cos * y, z + 1], 1) * half


def _ball_of_cube(cube: np.ndarray) -> np.ndarray:
    """Map the cube [-1, 1]^3 smoothly onto the unit ball (Nowell 2005)."""
    first, second, third = cube.T**2
    scale = np.stack(
        [
            1 - second / 2 - third / 2 + second * third / 3,
            1 - third / 2 - first / 2 + third * first / 3,
            1 - first / 2 - second / 2 + first * second / 3,
        ],
        1,
    )
    return np.asarray(cube * np.sqrt(scale))


def _shifted(ball: np.ndarray, shift: float) -> np.ndarray:
    """Move the plane x = 0 of the unit ball to x = shift; ball to ball, planes to planes."""
    moved = ball * np.r_[1.0, np.full(ball.shape[1] - 1, np.sqrt(1 - shift**2))]
    moved[:, 0] += shift
    return np.asarray(moved / (1 + shift * ball[:, :1]))


def _body(grids: list[Lattice], points: list[np.ndarray], sides: list[int]) -> Body:
    counts = [len(part) for part in points]
    starts = np.cumsum([0, *counts[:-1]])
    faces = np.concatenate([grid.faces + start for grid, start in zip(grids, starts, strict=True)])
    cut = np.concatenate([grid.face_of == {-1: 1, 1: 0, 0: -1}[side] for grid, side in zip(grids, sides, strict=True)])
    volumes = [_node_volumes(grid, part) for grid, part in zip(grids, points, strict=True)]
    surface, numbered = surface_vertices(faces)
    # nodes lie on the surface itself, so that no material extends beyond them
    particles = Particles(
        np.concatenate(points), np.concatenate(volumes), sides=np.repeat(sides, counts), radii=np.zeros(sum(counts))
    )
    return Body(particles, surface, numbered, cut)


def _node_volumes(grid: Lattice, points: np.ndarray) -> np.ndarray:
    """Return the volume of each node, an eighth of every adjacent cell, [N] [m^3]; sums to the lattice's volume."""
    shape = tuple(len(np.unique(column.round(12))) for column in grid.parameters.T)
    node = points.reshape(*shape, 3)
    corner = [
        node[i : shape[0] - 1 + i, j : shape[1] - 1 + j, k : shape[2] - 1 + k]
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    ]
    diagonal, cells = corner[7] - corner[0], np.zeros(tuple(n - 1 for n in shape))
    for a, b in ((4, 6), (6, 2), (2, 3), (3, 1), (1, 5), (5, 4)):
        cells += np.einsum("...i,...i", np.cross(corner[a] - corner[0], corner[b] - corner[0]), diagonal) / 6
    volumes = np.zeros(shape)
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                volumes[i : shape[0] - 1 + i, j : shape[1] - 1 + j, k : shape[2] - 1 + k] += np.abs(cells) / 8
    return volumes.ravel()
