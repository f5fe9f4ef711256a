"""Effects that a simulation hides: as given, drawn at random, scaled to a signal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from plop.errors import PlopError, SignalTooWeakError
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType
from plop.physics.hidden.response import Response, scaled_to, stable_rms
from plop.physics.hidden.wish import Wish, typical
from plop.physics.scenes.scene import Scene

_COARSER = 1.5
"""Particle spacing during the search for amplitudes, in units of the scene's."""
_RANDOM_SNR = (0.5, 2.0)
"""Signal of drawn effects, in units of the noise of one point; most effects cannot give more."""


def choose(
    scene: Scene,
    wishes: Sequence[Wish],
    *,
    snr: float,
    noise_floor_m: float,
    effects: dict[str, EffectType],
    progress: Callable[[float], None] = lambda share: None,
    jobs: int = 1,
    seed: int | None = None,
) -> list[Effect]:
    """Draw effects and scale amplitudes to the requested signal.

    Without `snr`, given amplitudes are kept, and drawn effects get a signal between 0.5 and 2.
    Each effect is scaled alone.

    Args:
        scene: The scene; its seed draws the motions.
        wishes: The effects to hide.
        snr: Requested root mean square of the displacement over `noise_floor_m`; 0 keeps the amplitudes.
        noise_floor_m: The noise [m].
        effects: All effects.
        progress: Called with the share that is done.
        jobs: See Response.
        seed: Draws; the scene's when absent.

    Raises:
        SignalTooWeakError: No amplitude in its range gives the requested signal.
        PlopError: No effect of the library can give it.
    """
    coarser = min(_COARSER, min(scene.shape.size_m) / 3 / scene.spacing_m)
    coarse = replace(scene, spacing_m=coarser * scene.spacing_m, dx_m=coarser * scene.dx_m)
    response = Response(coarse, jobs=jobs)
    chosen: list[Effect] = []
    for number, wish in enumerate(wishes):
        random = np.random.default_rng([scene.seed if seed is None else seed, number, 20])
        if wish.effect is None:
            taken = {effect.name for effect in chosen} | {w.effect.name for w in wishes if w.effect}
            chosen.append(_drawn(response, random, taken, snr, noise_floor_m, effects))
        elif snr:
            found = scaled_to(response, wish, snr * noise_floor_m)
            if found is None:
                raise _too_weak(response, wish, snr, noise_floor_m)
            chosen.append(found)
        else:
            chosen.append(wish.scaled(1.0))
        progress((number + 1) / len(wishes))
    return chosen


def _drawn(
    response: Response,
    random: np.random.Generator,
    taken: set[str],
    snr: float,
    noise_floor_m: float,
    effects: dict[str, EffectType],
) -> Effect:
    """Draw effects until one can give the signal."""
    names = sorted(name for name, effect in effects.items() if effect.kind == "physics" and name not in taken)
    wanted = snr or float(np.exp(random.uniform(*np.log(_RANDOM_SNR))))
    for name in random.permutation(names):
        effect = effects[str(name)]
        variant = effect.variants[int(random.integers(len(effect.variants)))]
        found = scaled_to(response, Wish(effect, dict(variant) | _direction(effect, random)), wanted * noise_floor_m)
        if found is not None:
            return found
    raise PlopError(
        "No effect is strong enough to be hidden here.",
        where="--hide random",
        expected=f"an effect that moves the object by {wanted * noise_floor_m * 1000:.2g} mm",
        found=f"a signal below {wanted:.1f} times the noise floor from all",
        fix="Lower --snr, or use motions that load the object more.",
    )


def _direction(effect: EffectType, random: np.random.Generator) -> dict[str, float]:
    """Draw the direction of several amplitudes; draw the sign where the range is symmetric."""
    size = typical(effect)
    turn = random.normal(size=len(size))
    if len(size) > 1:
        turn *= np.sqrt(len(size)) / np.linalg.norm(turn)
    else:
        # a change of a base value cannot go down; a symmetric range has two signs
        (p,) = effect.amplitudes
        turn = np.sign(turn) if p.low == -p.high and not p.name.startswith("d_") else np.ones(1)
    return {key: value * float(factor) for (key, value), factor in zip(size.items(), turn, strict=True)}


def _too_weak(response: Response, wish: Wish, snr: float, noise_floor_m: float) -> SignalTooWeakError:
    assert wish.effect is not None
    strongest = wish.scaled(response.affordable(wish))
    rms = stable_rms(response, strongest)
    reached = "an unstable run" if rms is None else f"SNR {rms / noise_floor_m:.2g}"
    return SignalTooWeakError(
        "The effect cannot give the requested signal in these motions.",
        where=f"--hide {wish.effect.name}",
        expected=f"SNR {snr:g}",
        found=f"{reached} at {strongest}, the largest that can be computed",
        fix="Lower --snr, or use motions in which the effect acts.",
    )
