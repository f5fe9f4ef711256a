"""Blocks of particles that the physics tests share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from plop.physics.engine.particles import Particles


def _block(size_m, spacing_m, *, bottom_m=0.0, **state) -> Particles:
    """Fill a box that stands at `bottom_m`, centred on the z axis, with one particle per cell."""
    counts = np.maximum(1, np.round(np.asarray(size_m) / spacing_m)).astype(int)
    step = np.asarray(size_m) / counts
    axes = [(np.arange(n) + 0.5) * d for n, d in zip(counts, step, strict=True)]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    positions += [-size_m[0] / 2, -size_m[1] / 2, bottom_m]
    return Particles(positions, np.full(len(positions), step.prod()), **state)


@pytest.fixture(scope="session")
def block() -> Callable[..., Particles]:
    return _block
