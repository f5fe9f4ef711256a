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
from plop.physics.engine.time_step import STEP_RATIO, stable_step_s
from plop.physics.hidden.wish import Wish
from plop.physics.scenes.scene import Scene, simulate_episode

_TOLERANCE = 0.05
_ROUNDS = 7
_SLOWER = 8.0
"""Largest factor in the number of time steps that a scaled amplitude may cause."""


class Response:
    """Displacement caused by effects in the episodes of a scene; runs without effects are cached.

    Both runs take time steps of the same length: more of them dissipate more, which no effect causes.
    """

    def __init__(self, scene: Scene, *, jobs: int = 1) -> None:
        """Create the response of a scene.

        Args:
            scene: The scene.
            jobs: Number of processes; effects of the user's files are known in this one only.
        """
        self.scene, self.jobs = scene, jobs
        self._base: dict[tuple[int, int], np.ndarray] = {}
        """Runs without effects, by episode, and by how many times STEP_RATIO their time steps are shorter."""

    def affordable(self, wish: Wish) -> float:
        """Return the largest factor of a wish that needs at most `_SLOWER` times as many time steps."""
        config, factor = EngineConfig(dx_m=self.scene.dx_m), wish.most()
        while factor > 1e-3 and slowdown([wish.scaled(factor)], self.scene.material, config) > _SLOWER:
            factor *= 0.8
        return factor

    def rms_m(self, *effects: Effect) -> float:
        """Root mean square over all surface points and frames of one episode of each kind [m]."""
        kinds = min(self.scene.episodes, len(self.scene.motions))
        shorter = self._shorter(effects)
        lacking = [k for k in range(kinds) if (k, shorter) not in self._base]
        wanted = [(k, effects, np.inf) for k in range(kinds)] + [(k, (), self._step_s(shorter)) for k in lacking]
        with workers():
            found = Parallel(n_jobs=self.jobs)(delayed(_vertices)(self.scene, *each) for each in wanted)
        self._base |= {(k, shorter): vertices for k, vertices in zip(lacking, found[kinds:], strict=True)}
        squares = [self.squares(k, found[k], effects) for k in range(kinds)]
        return float(np.sqrt(sum(total for total, _ in squares) / sum(count for _, count in squares)))

    def squares(self, k: int, vertices: np.ndarray, effects: Sequence[Effect]) -> tuple[float, int]:
        """Sum of squared displacements from the run without effect [m^2], and their number.

        Args:
            k: Number of the episode.
            vertices: The run with effects, [T, V, 3] [m].
            effects: They.
        """
        key = k, self._shorter(effects)
        if key not in self._base:
            self._base[key] = _vertices(self.scene, k, (), self._step_s(key[1]))
        return float(((vertices - self._base[key]) ** 2).sum()), vertices.shape[0] * vertices.shape[1]

    def _shorter(self, effects: Sequence[Effect]) -> int:
        """Tell by how many times STEP_RATIO the time steps with some effects are shorter than without."""
        factor = slowdown(effects, self.scene.material, EngineConfig(dx_m=self.scene.dx_m))
        return max(0, round(float(np.log(factor) / np.log(STEP_RATIO))))

    def _step_s(self, shorter: int) -> float:
        """Give the longest time step of runs that are to be compared [s]."""
        if shorter == 0:
            return np.inf
        return stable_step_s(self.scene.material, EngineConfig(dx_m=self.scene.dx_m)) / STEP_RATIO**shorter


def _vertices(scene: Scene, k: int, effects: Sequence[Effect], most_step_s: float) -> np.ndarray:
    return simulate_episode(scene, k, effects, most_step_s).vertices


def slowdown(effects: Sequence[Effect], material: Material, config: EngineConfig) -> float:
    """Return the factor in the number of time steps caused by effects."""
    own, around = material, config
    for effect in effects:
        own, around = effect.material(own), effect.config(around)
    steps = [stable_step_s(own, around), *(effect.slowest_step_s(own, around) for effect in effects)]
    return stable_step_s(material, config) / min(steps)


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
