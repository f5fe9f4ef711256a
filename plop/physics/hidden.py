"""Effects that a simulation hides: read as a user types them, drawn at random, scaled to a signal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.errors import PlopError
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType, effect_type
from plop.physics.scene import Scene, simulate_episode

RANDOM = "random"
"""What a user types to have an effect drawn."""
_COARSER = 1.5
"""Amplitudes are sought at this many times the scene's spacing."""
_RANDOM_SNR = (2.0, 6.0)
_TOLERANCE = 0.05
_ROUNDS = 7


@dataclass(frozen=True)
class Wish:
    """One effect that shall be hidden."""

    effect: EffectType | None
    """None: to be drawn."""
    values: dict[str, float]
    """Parameters that were given."""

    def scaled(self, factor: float) -> Effect:
        """Give the effect with its amplitudes multiplied.

        Raises:
            PlopError: An amplitude leaves its range.
        """
        assert self.effect is not None
        given = {p.name for p in self.effect.amplitudes} & self.values.keys()
        start = self.values if given else self.values | _typical(self.effect)
        names = {p.name for p in self.effect.amplitudes}
        return self.effect(**{key: value * factor if key in names else value for key, value in start.items()})

    def most(self) -> float:
        """Give the largest factor at which all amplitudes stay in their ranges."""
        assert self.effect is not None
        limits = [np.inf]
        for p in self.effect.amplitudes:
            value = self.scaled(1.0)[p.name]
            limits += [(p.high if value > 0 else p.low) / value] if value else []
        return float(min(limits))


def parse_hidden(texts: Sequence[str], effects: dict[str, EffectType] | None = None) -> list[Wish]:
    """Read `EFFECT=AMPLITUDE`, `EFFECT.PARAMETER=VALUE`, `EFFECT` alone, or `random`.

    Several texts on one effect are one wish; `random` may stand several times.

    Args:
        texts: What the user typed, one each.
        effects: All effects there are; None takes the project's.

    Raises:
        PlopError: An unknown effect or parameter, no number, or a value out of range.
    """
    drawn, named = [Wish(None, {}) for text in texts if text.strip() == RANDOM], dict[str, Wish]()
    for text in (text.strip() for text in texts if text.strip() != RANDOM):
        left, equals, number = text.partition("=")
        name, _, parameter = left.strip().partition(".")
        effect = effect_type(name, effects)
        wish = named.setdefault(name, Wish(effect, {}))
        if not equals:
            continue
        try:
            wish.values[parameter or effect.amplitudes[0].name] = float(number)
        except ValueError:
            raise PlopError("A hidden effect cannot be read.", where=text, found=repr(number),
                            expected="EFFECT=AMPLITUDE or EFFECT.PARAMETER=VALUE with a number",
                            fix=f"For example {name}={effect.amplitudes[0].typical:g}.") from None  # fmt: skip
    for wish in named.values():
        wish.scaled(1.0)
    return [*named.values(), *drawn]


def choose(
    scene: Scene, wishes: Sequence[Wish], *, snr: float, noise_floor_m: float, effects: dict[str, EffectType],
    progress: Callable[[float], None] = lambda share: None,
) -> list[Effect]:  # fmt: skip
    """Draw what is to be drawn and scale amplitudes to the wanted signal.

    Without `snr`, given amplitudes stay as they are, and effects that are drawn get a signal between 2 and 6.
    Each effect is scaled alone.

    Args:
        scene: What is simulated; its seed draws.
        wishes: What shall be hidden.
        snr: Wanted root mean square of the displacement over `noise_floor_m`; 0 leaves amplitudes alone.
        noise_floor_m: What counts as noise [m].
        effects: All effects there are.
        progress: Called with the share that is done.

    Raises:
        PlopError: No amplitude in its range gives the wanted signal.
    """
    coarse = replace(scene, spacing_m=_COARSER * scene.spacing_m, dx_m=_COARSER * scene.dx_m)
    response = Response(coarse)
    chosen: list[Effect] = []
    for number, wish in enumerate(wishes):
        random = np.random.default_rng([scene.seed, number, 20])
        if wish.effect is None:
            taken = {effect.name for effect in chosen} | {w.effect.name for w in wishes if w.effect}
            chosen.append(_drawn(response, random, taken, snr, noise_floor_m, effects))
        elif snr:
            found = _scaled_to(response, wish, snr * noise_floor_m)
            if found is None:
                raise _too_weak(wish, snr, response.rms_m(wish.scaled(wish.most())) / noise_floor_m)
            chosen.append(found)
        else:
            chosen.append(wish.scaled(1.0))
        progress((number + 1) / len(wishes))
    return chosen


class Response:
    """Displacement that effects cause in the episodes of a scene; runs without effect are kept."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._base: dict[int, np.ndarray] = {}

    def rms_m(self, *effects: Effect) -> float:
        """Root mean square over all surface points, frames and episodes [m]."""
        squares = [self.squares(k, simulate_episode(self.scene, k, effects).vertices)
                   for k in range(self.scene.episodes)]  # fmt: skip
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


def _drawn(
    response: Response, random: np.random.Generator, taken: set[str], snr: float, noise_floor_m: float,
    effects: dict[str, EffectType],
) -> Effect:  # fmt: skip
    """Draw an effect that can give the signal; the draw goes on until one can."""
    names = sorted(name for name, effect in effects.items() if effect.kind == "physics" and name not in taken)
    wanted = snr or float(np.exp(random.uniform(*np.log(_RANDOM_SNR))))
    for name in random.permutation(names):
        effect = effects[str(name)]
        variant = effect.variants[int(random.integers(len(effect.variants)))]
        found = _scaled_to(response, Wish(effect, dict(variant) | _direction(effect, random)), wanted * noise_floor_m)
        if found is not None:
            return found
    raise PlopError("No effect can be hidden here.", where="--hide random",
                    expected=f"an effect that moves the object by {wanted * noise_floor_m * 1000:.2g} mm",
                    found=f"a signal below {wanted:.1f} times the noise floor from all",
                    fix="Lower --snr, or take motions that load the object more.")  # fmt: skip


def _typical(effect: EffectType) -> dict[str, float]:
    return {p.name: p.typical or p.step for p in effect.amplitudes}


def _direction(effect: EffectType, random: np.random.Generator) -> dict[str, float]:
    """Turn several amplitudes into a random direction; choose the sign where both are alike."""
    size = _typical(effect)
    turn = random.normal(size=len(size))
    if len(size) > 1:
        turn *= np.sqrt(len(size)) / np.linalg.norm(turn)
    else:
        # a change of a base value has no room downwards; a range that is alike on both sides has two signs
        (p,) = effect.amplitudes
        turn = np.sign(turn) if p.low == -p.high and not p.name.startswith("d_") else np.ones(1)
    return {key: value * float(factor) for (key, value), factor in zip(size.items(), turn, strict=True)}


def _scaled_to(response: Response, wish: Wish, wanted_m: float) -> Effect | None:
    """Find the amplitude with the wanted response, by secants of log response over log factor.

    Returns:
        None when no amplitude in its range, or none at which the run is stable, comes near.
    """
    most = wish.most()
    low, high = 0.0, np.inf  # factors known to be too weak, and too strong or unstable
    factor, slope, last = min(1.0, most), 1.0, None
    for _ in range(_ROUNDS):
        rms = _stable_rms(response, wish.scaled(factor))
        if rms is None:
            high, factor = factor, factor / 3 if not low else float(np.sqrt(low * factor))
            continue
        if abs(rms / wanted_m - 1) < _TOLERANCE:
            return wish.scaled(factor)
        if last is not None and rms != last[1] and factor != last[0] and min(rms, last[1]) > 0:
            slope = float(np.clip(np.log(rms / last[1]) / np.log(factor / last[0]), 0.3, 3))
        last = (factor, rms)
        low, high = (factor, high) if rms < wanted_m else (low, factor)
        if factor >= most and rms < wanted_m:
            return None
        step = factor * float(np.clip((wanted_m / max(rms, 1e-9)) ** (1 / slope), 0.02, 50))
        if not low < step < high:
            step = float(np.sqrt(max(low, factor / 50) * high)) if np.isfinite(high) else factor * 5
        factor = min(step, most)
    near = _stable_rms(response, wish.scaled(factor))
    return wish.scaled(factor) if near is not None and abs(near / wanted_m - 1) < 4 * _TOLERANCE else None


def _stable_rms(response: Response, effect: Effect) -> float | None:
    try:
        return response.rms_m(effect)
    except PlopError:
        return None


def _too_weak(wish: Wish, snr: float, reached: float) -> PlopError:
    assert wish.effect is not None
    strongest = wish.scaled(wish.most())
    return PlopError("The effect cannot give the wanted signal in these motions.", where=f"--hide {wish.effect.name}",
                     expected=f"SNR {snr:g}", found=f"SNR {reached:.2g} at the end of its range, {strongest}",
                     fix="Lower --snr, or take motions in which the effect acts.")  # fmt: skip
