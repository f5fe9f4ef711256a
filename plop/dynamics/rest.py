"""Where each Gaussian lay at the first frame, and who its neighbours were there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from torch import Tensor

from plop.geometry.clouds.neighbours import nearest

_NEIGHBOURS = 20
"""As many as the physical terms of the loss look at (`plop.dynamics.losses.physical`)."""


@dataclass(frozen=True)
class RestPlaces:
    """The first frame's places of the Gaussians that there are now, or of those that they descend from."""

    places: Tensor
    """Shape [N, 3] [m]."""

    @cached_property
    def neighbours(self) -> np.ndarray:
        """The nearest others of each, shape [N, k], k <= 20, int64, nearest first; found when first asked for."""
        return np.ascontiguousarray(nearest(self.places, _NEIGHBOURS)[1].cpu().numpy())

    def select(self, index: Tensor) -> RestPlaces:
        """Take those of a subset; `index` may name one more than once."""
        return RestPlaces(self.places[index])

    def moved(self, shift: Tensor) -> RestPlaces:
        """Displace the places by `shift`, shape [N, 3] [m]: the halves of a split one do not lie in one place."""
        return RestPlaces(self.places + shift)
