"""The background grid: where its nodes are, which chunk of particles reaches which, and the kernels' arrays on it."""

from __future__ import annotations

import numpy as np

_MARGIN = 3
"""Free cells between the particles and the end of the grid."""


class BackgroundGrid:
    """Nodes at multiples of the cell's edge around all particles, and memory that only grows."""

    def __init__(self, dx_m: float, table_z_m: float | None, chunks: int) -> None:
        self.dx, self._inv_dx, self._dx_m = np.float32(dx_m), np.float32(1 / dx_m), dx_m
        self._base = np.array([0.0, 0.0, table_z_m or 0.0])
        self._chunks, self._room = chunks, 0
        self.report, self.pushes = np.zeros((chunks, 2), np.float32), np.zeros((chunks, 3), np.float32)

    @property
    def frame(self) -> tuple[np.ndarray, np.ndarray, np.float32]:
        """Place of the first node [m], nodes along each axis, and nodes per metre, as the kernels take them."""
        return self._origin, self._dims, self._inv_dx

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(np.prod(self._dims))

    def lay(self, low_m: np.ndarray, high_m: np.ndarray) -> None:
        """Place the nodes around a box given by its lowest and highest corner [m]."""
        low = np.floor((low_m - self._base) / self._dx_m).astype(np.int64) - _MARGIN
        high = np.ceil((high_m - self._base) / self._dx_m).astype(np.int64) + _MARGIN
        self._origin, self._dims = (self._base + low * self._dx_m).astype(np.float32), high - low + 1

    def cell_order(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Order places [N, 3] [m] by cell; also returns each cell's column along x in that order."""
        cell = ((x - self._origin) * self._inv_dx).astype(np.int64)
        order = np.lexsort((cell[:, 2], cell[:, 1], cell[:, 0]))
        return order, cell[order, 0]

    def divide(self, column: np.ndarray) -> None:
        """Divide sorted particles, of which the columns along x are given, into chunks; make room for the nodes."""
        self.bounds = np.linspace(0, len(column), self._chunks + 1).astype(np.int64)
        parts = [column[a:b] for a, b in zip(self.bounds[:-1], self.bounds[1:], strict=True)]
        self.planes = np.array(
            [[max(part[0] - 2, 0), min(part[-1] + 4, self._dims[0])] if len(part) else [0, 0] for part in parts]
        )
        if self.size > self._room:
            self._allocate(self.size * 5 // 4)
        self.impulses = np.zeros((int(self._dims[0]), 3), np.float32)

    def _allocate(self, room: int) -> None:
        self._room = room
        self.chunk_nodes = np.zeros((self._chunks, room, 8), np.float32)
        self.chunk_passed = np.zeros((self._chunks, room), np.float32)
        self.nodes, self.passed = np.zeros((room, 8), np.float32), np.zeros(room, np.float32)
        self.gaps, self.velocity = np.zeros(room, np.float32), np.zeros((room, 2, 4), np.float32)
