"""Kernel: whether Gaussians can be rendered; one short pass, since every rendering asks."""

from __future__ import annotations

import math

from plop.compute.cpu_kernels import kernel

OPACITY_LOW, OPACITY_HIGH = -1e-3, 1 + 1e-3
"""Accepted range of opacities."""


@kernel
def _sum(values):  # type: ignore[no-untyped-def]
    total = 0.0
    for value in values.flat:
        total += value
    return total


@kernel
def is_sound(means, quats, scales, opacities, sh):  # type: ignore[no-untyped-def]
    """Return whether all numbers are finite, opacities in range and no quaternion zero; if in doubt, False."""
    total = _sum(means) + _sum(quats) + _sum(scales) + _sum(opacities) + _sum(sh)
    if not abs(total) < math.inf:  # isfinite subtracts, which fast maths may leave out
        return False
    shortest, low, high = math.inf, 0.0, 0.0
    for g in range(len(opacities)):
        w, x, y, z = quats[g]
        shortest = min(shortest, w * w + x * x + y * y + z * z)
        low, high = min(low, opacities[g]), max(high, opacities[g])
    return shortest > 0 and low >= OPACITY_LOW and high <= OPACITY_HIGH
