"""Points without volume that move with the material: they feel the grid, and the grid does not feel them."""

from __future__ import annotations

import numpy as np

_SORTED = ("x", "v", "c", "f", "side", "fixed", "cut", "number")


class Tracers:
    """Tracers of one run, sorted as the engine sorts its particles.

    Takes what the engine's arrays hold of them: positions, velocities, affine velocities, deformation
    gradients, sides and whether they are fixed, passage of the blade, and the number in the caller's order.
    """

    def __init__(
        self,
        x: np.ndarray,
        v: np.ndarray,
        c: np.ndarray,
        f: np.ndarray,
        side: np.ndarray,
        fixed: np.ndarray,
        cut: np.ndarray,
        number: np.ndarray,
    ) -> None:
        self.x, self.v, self.c, self.f = x, v, c, f
        self.side, self.fixed, self.cut, self.number = side, fixed, cut, number
        self.radius = np.zeros(len(x), np.float32)
        self._bounds = np.zeros(2, np.int64)
        self.report = np.zeros(1, np.float32)
        """Highest squared speed of each chunk in the last step [m^2/s^2]."""

    def __len__(self) -> int:
        return len(self.number)

    def save(self) -> dict[str, np.ndarray]:
        """Copy what a time step and `sort` change."""
        return {name: getattr(self, name).copy() for name in _SORTED}

    def restore(self, saved: dict[str, np.ndarray]) -> None:
        """Go back to a saved state."""
        for name in _SORTED:
            setattr(self, name, saved[name].copy())

    def sort(self, order: np.ndarray, chunks: int) -> None:
        """Put the tracers into an order and cut them into chunks."""
        for name in _SORTED:
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[order]))
        self._bounds = np.linspace(0, len(self), chunks + 1).astype(np.int64)
        self.report = np.zeros(chunks, np.float32)

    @property
    def to_mark(self) -> tuple[np.ndarray, ...]:
        """What the blade changes, see `plop.physics.engine.kernels.step.touch`."""
        return self.x, self.side, self.cut, self.fixed, self.radius, self._bounds

    @property
    def to_move(self) -> tuple[np.ndarray, ...]:
        """What the grid moves, see `plop.physics.engine.kernels.step.advance`."""
        return self.x, self.v, self.c, self.f, self.side, self._bounds
