"""The common interface of all renderers of Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Rendering:
    """One rendered view."""

    rgb: Tensor
    """Colour over the background, shape [H, W, 3], 0..1."""
    depth_m: Tensor
    """Expected depth along the optical axis, sum(w z) / max(alpha, 1e-6), shape [H, W] [m]; 0 where alpha is 0."""
    alpha: Tensor
    """Accumulated opacity, shape [H, W], 0..1."""
