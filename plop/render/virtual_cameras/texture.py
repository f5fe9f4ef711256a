"""A procedural colour through the whole solid: it moves with the material, outside and on cut faces."""

from __future__ import annotations

import colorsys
import hashlib
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

Texture = Literal["waves", "dough"]
"""Textures of an object: strong colours that make every position unique, or a plausible soft object."""
_DOUGHS = ((0.80, 0.62, 0.40), (0.76, 0.50, 0.36), (0.66, 0.58, 0.34), (0.72, 0.42, 0.40))
"""Colours of crust, caramel, pistachio and red bean."""


def seed_from(*parts: str | int) -> int:
    """Return a 64-bit seed that is the same for the same parts on every machine."""
    return int.from_bytes(hashlib.sha256("/".join(map(str, parts)).encode()).digest()[:8], "little")


@dataclass(frozen=True)
class SolidTexture:
    """A smooth random colour field over material points: a base colour plus plane waves."""

    outside: np.ndarray
    """Base colour of the outer surface, shape [3], 0..1."""
    inside: np.ndarray
    """Base colour of faces created by a cut, of another hue, shape [3], 0..1."""
    waves: np.ndarray
    """Wave vectors, shape [K, 3], float32 [rad/m]."""
    phases: np.ndarray
    """Shape [K], float32 [rad]."""
    weights: np.ndarray
    """Colour of every wave, shape [K, 3], float32."""

    @classmethod
    def from_seed(
        cls, seed: int, *, shortest_m: float = 0.015, longest_m: float = 0.06, count: int = 7, contrast: float = 0.15
    ) -> SolidTexture:
        """Draw a texture.

        Args:
            seed: Same seed, same texture.
            shortest_m: Shortest wavelength [m].
            longest_m: Longest wavelength [m].
            count: Number of waves.
            contrast: Root mean square of the pattern around the base colour, in each channel.
        """
        random = np.random.default_rng(seed)
        directions = random.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        lengths = np.geomspace(shortest_m, longest_m, count)
        weights = random.normal(size=(count, 3)) * np.sqrt(lengths / longest_m)[:, None]
        weights *= contrast / np.sqrt((weights**2).sum(0) / 2)
        hue = random.random()
        return cls(
            outside=np.array(colorsys.hsv_to_rgb(hue, 0.35, 0.62), np.float32),
            inside=np.array(colorsys.hsv_to_rgb((hue + 0.4) % 1.0, 0.6, 0.70), np.float32),
            waves=(directions * (2 * np.pi / lengths)[:, None]).astype(np.float32),
            phases=random.uniform(0, 2 * np.pi, count).astype(np.float32),
            weights=weights.astype(np.float32),
        )

    @classmethod
    def dough(cls, seed: int, *, contrast: float = 0.13) -> SolidTexture:
        """Draw a marbled dough: one warm colour that gets lighter and darker, a paler one where it is cut.

        Nearly all of the pattern is in brightness, as in food, so that it can be tracked without strong colours.

        Args:
            seed: Same seed, same texture.
            contrast: Root mean square of the pattern around the base colour, mean of the channels.
        """
        random = np.random.default_rng(seed)
        base = np.array(_DOUGHS[random.integers(len(_DOUGHS))], np.float32)
        drawn = cls.from_seed(seed, shortest_m=0.009, longest_m=0.045, count=14, contrast=contrast)
        # Darker dough is redder: the three channels vary together, blue the most.
        grey = drawn.weights.mean(1)
        grey *= contrast / np.sqrt((grey**2).sum() / 2)
        tint = np.array([0.8, 1.0, 1.2], np.float32)
        return replace(
            drawn,
            outside=base,
            inside=0.45 * base + 0.55 * np.array([0.97, 0.90, 0.76], np.float32),
            weights=(grey[:, None] * tint + 0.1 * drawn.weights).astype(np.float32),
        )

    def colour(self, rest_points: np.ndarray, is_inside: np.ndarray) -> np.ndarray:
        """Return the colour of material points.

        Args:
            rest_points: Material positions, shape [N, 3] [m].
            is_inside: Points on faces created by a cut, bool, shape [N].

        Returns:
            Colour before shading, shape [N, 3], float32, 0.02..0.98.
        """
        points = np.asarray(rest_points, np.float32)
        pattern = np.sin(points @ self.waves.T + self.phases) @ self.weights
        base = np.where(is_inside[:, None], self.inside, self.outside)
        return np.asarray(np.clip(base + pattern, 0.02, 0.98))
