"""The displacement caused by effects, and the amplitude for a requested displacement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.errors import PlopError
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.time_step import stable_step_s
from plop.physics.hidden.wish import Wish
from plop.physics.scenes.scene import Scene, simulate_episode

_TOLERANCE = 0.05
_ROUNDS = 7
_SLOWER = 8.0
"""Largest factor in the number of time steps that a scaled amplitude may cause."""


class Response:
    """Displacement caused by effects in the episodes of a scene; runs without effects are cached."""

    def __init__(self, scene: Scene, *, jobs: int = 1) -> None:
        """Create the response of a scene.

        Args:
            scene: The scene.
            jobs: Number of processes; effects of the user's files are known in this one only.
        """
        self.scene, self.jobs = scene, jobs
        self._base: dict[int, np.ndarray] = {}

    def affordable(self, wish: Wish) -> float:
        """Return the largest factor of a wish that needs at most `_SLOWER` times as many time steps."""
        config, factor = EngineConfig(dx_m=self.scene.dx_m), wish.most()
        while factor > 1e-3 and slowdown(wish.scaled(factor), self.scene.material, config) > _SLOWER:
            factor *= 0.8
        return factor

    def rms_m(self, *effects: Effect) -> float:
        """Root mean square over all surface points and frames of one episode of each kind [m]."""
        kinds = min(self.scene.episodes, len(self.scene.motions))
        wanted = [(k, effects) for k in range(kinds)] + [(k, ()) for k in range(kinds) if k not in self._base]
        with workers():
            found = Parallel(n_jobs=self.jobs)(delayed(_vertices)(self.scene, k, given) for k, given in wanted)
        self._base |= {k: vertices for (k, given), vertices in zip(wanted, found, strict=True) if not given}
        squares = [self.squares(k, found[k]) for k in range(kinds)]
        return float(np.sqrt(sum(total for total, _ in squares) / sum(count for _, count in squares)))

    def squares(self, k: int, vertices: np.ndarray) -> tuple[float, int]:
        """Sum of squared displacements from the run without effect [m^2], and their number.

        Args:
            k: Number of the episode.
            vertices: The run with effects, [T, V, 3] [m].
        """
        if k not in self._base:
            self._base[k] = simulate_episode(self.scene, k).vertices
        return float(((vertices - self._base[k]) ** 2).sum()), vertices.shape[0] * vertices.shape[1]


def _vertices(scene: Scene, k: int, effects: Sequence[Effect]) -> np.ndarray:
    return simulate_episode(scene, k, effects).vertices


def slowdown(effect: Effect, material: Material, config: EngineConfig) -> float:
    """Return the factor in the number of time steps caused by an effect."""
    own, around = effect.material(material), effect.config(config)
    return stable_step_s(material, config) / min(stable_step_s(own, around), effect.slowest_step_s(own, around))


def scaled_to(response: Response, wish: Wish, wanted_m: float) -> Effect | None:
    """Find the amplitude with the requested response, by secants of log response over log factor.

    Returns:
        None when no amplitude in its range, or none with a stable run, comes close.
    """
    most = response.affordable(wish)
    low, high = 0.0, np.inf  # factors known to be too weak, and too strong or unstable
    factor, slope, last = min(1.0, most), 1.0, None
    for _ in range(_ROUNDS):
        rms = stable_rms(response, wish.scaled(factor))
        if rms is None:
            high, factor = factor, float(np.sqrt(low * factor)) if low else factor / 3
            continue
        if abs(rms / wanted_m - 1) < _TOLERANCE:
            return wish.scaled(factor)
        # responses are concave, if not linear: out of reach when a linear extrapolation does not get there
        if rms < wanted_m and (factor >= most or (last is None and 2 * rms * most / factor < wanted_m)):
            return None
        if last is not None and factor != last[0] and min(rms, last[1]) > 0 and rms != last[1]:
            slope = float(np.clip(np.log(rms / last[1]) / np.log(factor / last[0]), 0.3, 3))
        last = (factor, rms)
        low, high = (factor, high) if rms < wanted_m else (low, factor)
        step = factor * float(np.clip((wanted_m / max(rms, 1e-9)) ** (1 / slope), 0.02, 20))
        if not low < step < high:
            step = float(np.sqrt(max(low, factor / 50) * high)) if np.isfinite(high) else factor * 5
        factor = min(step, most)
    near = stable_rms(response, wish.scaled(factor))
    return wish.scaled(factor) if near is not None and abs(near / wanted_m - 1) < 4 * _TOLERANCE else None


def stable_rms(response: Response, effect: Effect) -> float | None:
    """Return the response [m], or None where the run is unstable."""
    try:
        return response.rms_m(effect)
    except PlopError:
        return None
