"""Sets of episodes drawn at random whose amplitudes of one law are compared, without any engine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from plop.diagnosis.contrast import contrast_of
from plop.diagnosis.regression import Grams

KINDS = {"one kind": (["a"] * 8, ["a"] * 12), "four kinds": (list("abcd") * 2, list("abcd") * 3)}
"""Kind of motion of every episode, and of every one of the reference."""
_LITTLE = 0.01
"""What an episode holds of a law that hardly shows in it, as a share of what others hold."""
Draw = Callable[[np.random.Generator, int], np.ndarray]


def _two(generator: np.random.Generator, count: int) -> np.ndarray:
    held = np.full(count, _LITTLE)
    held[generator.choice(count, 2, replace=False)] = 1
    return held


HELD: dict[str, Draw] = {
    "alike": lambda generator, count: np.ones(count),
    "0.3 to 3 times": lambda generator, count: generator.uniform(0.3, 3, count),
    "spread widely": lambda generator, count: np.exp(1.5 * generator.normal(size=count)),
    "nearly all in two episodes": _two,
    "nearly all in every fourth": lambda generator, count: np.where(np.arange(count) % 4, _LITTLE, 1.0),
}
"""What each episode holds of a law."""
SCATTERS = ("by what they hold", "between both", "all alike")
"""How amplitudes of episodes scatter: as noise makes them (less where much is held), the same everywhere, or between:
their squared residuals grow as the root of what is held."""


def drawn_grams(
    generator: np.random.Generator, held: np.ndarray, amplitudes: list[np.ndarray], scatter: str = SCATTERS[0]
) -> Grams:
    """Draw episodes that hold so much [E] of a law with some amplitudes [own] in each; one base column comes first."""
    hessians, gradients = [], []
    for share, amplitude in zip(held, amplitudes, strict=True):
        columns = generator.normal(size=(1 + len(amplitude), 6))
        columns[1:] *= np.sqrt(share)
        hessian = columns @ columns.T
        noise = columns @ generator.normal(size=6)
        if scatter == SCATTERS[1]:
            noise *= share**0.25
        if scatter == SCATTERS[2]:
            noise = hessian @ np.concatenate([[0], generator.normal(size=len(amplitude))])
        hessians.append(hessian)
        gradients.append(hessian @ np.concatenate([[0.3 * generator.normal()], amplitude]) + noise)
    return Grams(np.array(hessians), np.array(gradients), np.ones(len(held)))


def contrast_chances(
    kinds: tuple[list[str], list[str]],
    held: Draw,
    scatter: str,
    own: int,
    runs: int,
    *,
    change: float = 0.0,
    apart: float = 1.0,
    told: bool = True,
) -> np.ndarray:
    """Compare many pairs of sets; give p of each.

    Args:
        kinds: Kind of motion of every episode, here and in the reference.
        held: What each holds.
        scatter: See `SCATTERS`.
        own: Amplitudes of the law.
        runs: Pairs.
        change: By how much the amplitude differs here.
        apart: How much what the base alone resembles differs between kinds.
        told: Whether kinds are told; all episodes are taken for one kind otherwise.
    """
    generator, found = np.random.default_rng(own), np.empty(runs)
    names = kinds if told else (["any"] * len(kinds[0]), ["any"] * len(kinds[1]))
    for k in range(runs):
        alone = {kind: apart * generator.normal(size=own) for kind in sorted({*kinds[0], *kinds[1]})}
        sets = [
            drawn_grams(generator, held(generator, len(labels)), [alone[kind] + more for kind in labels], scatter)
            for labels, more in zip(kinds, (change, 0.0), strict=True)
        ]
        found[k] = contrast_of(sets[0], sets[1], np.arange(1 + own), own, 1, names).p
    return found
