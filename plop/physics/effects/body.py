"""The interface of laws to the engine's state in a time step."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material


class Body(Protocol):
    """N particles, the tool and the base's parameters in one time step.

    Arrays are changed in place; the engine sorts them all together at intervals, so that rows refer to the same
    particles only within one hook. Tracers are not included.
    """

    x: np.ndarray
    """Positions, float32 [N, 3] [m]."""
    v: np.ndarray
    """Velocities, float32 [N, 3] [m/s]."""
    c: np.ndarray
    """Local velocity gradients, float32 [N, 3, 3] [1/s]."""
    f: np.ndarray
    """Deformation gradients, float32 [N, 3, 3] [-]; their elastic part under a flow rule."""
    mass: np.ndarray
    """Masses, float32 [N] [kg]."""
    volume: np.ndarray
    """Rest volumes, [N] [m^3]."""
    radius: np.ndarray
    """Distance from the particle to the end of its material, float32 [N] [m]: 0 on a lattice's surface."""
    side: np.ndarray
    """Side of the blade, int [N]: 0 where its normal points, 1 behind it."""
    cut: np.ndarray
    """Whether a blade has passed the particle, bool [N]."""
    number: np.ndarray
    """The particle's index in the caller's order, int [N]; it does not change."""
    memory: dict[str, np.ndarray]
    """Memory of the laws, "<effect>.<name>" -> float32 [N, ...]; see `Effect.remembers`."""
    pose: np.ndarray
    """The tool, float32 [6, 3]: origin [m], three axes, velocity [m/s], turning rate [1/s]; see `kernel_poses`."""
    extra: np.ndarray
    """Kirchhoff stress added by laws, float32 [N, 6] (xx, yy, zz, xy, xz, yz) [Pa]; [0, 6] where none adds stress."""
    impulse: np.ndarray
    """Impulse on the object in this step from table and tool, float64 [2, 3] [N s]; a law adds its own."""
    material: Material
    """The base's parameters, including the changes by laws."""
    config: EngineConfig
    """Grid, gravity, table and time step."""

    @property
    def elastic(self) -> tuple[int, np.float32, np.float32]:
        """Number of the elastic law and Lame's mu and lambda [Pa], as arguments of kernels."""

    @property
    def tool_now(self) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Kind (`ToolKind`), pose, faces and thickness (`ToolShape`) of the tool, as arguments of kernels."""
