"""False alarms: the same scorer on evidence that is wrong on purpose; the best score of the whole library counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.diagnosis.evidence import BLOCKS, Whitened
from plop.diagnosis.regression import Grams
from plop.diagnosis.screen import Screen

SIGNS_LEAST = 7
"""Episodes from which on their signs tell: those of a law that moves points along one axis come out as they are, or all
turned, once in 2 ** (episodes - 1), and p of 2 % must be in reach."""
SHAMS = 199
"""Shams; the smallest possible p is 1 / (SHAMS + 1)."""


def sham_gains(screen: Screen, *, seed: int = 0, count: int = SHAMS, alone: bool = False) -> np.ndarray:
    """Give the best gain over the library under each sham.

    Shams keep the size of the residuals and spoil their relation to the candidates: in some parts of the object
    they change their sign (what a law explains has its sign everywhere), and in three of four shams the
    responses are besides shifted in time by part of an episode (a tool history of another stroke), turned by
    a quarter about the vertical (a wrong direction), or moved to other patches (a wrong contact). Base
    parameters are left as they are.

    A base may err smoothly over the whole object, and what errs together is then no proof that a law is there. The
    reference tells such errors from a law (`contrast`). Where there is none, every second sham leaves the residuals
    of an episode as smooth as they are, and changes the sign of each of their components in the whole of it. Fewer than
    SIGNS_LEAST episodes have too few signs for that.

    Args:
        screen: The real evidence.
        seed: Draws the shams.
        count: Number of shams.
        alone: There is no reference.

    Returns:
        Shape [count].
    """
    generator, whole = np.random.default_rng([seed, 99]), alone and len(screen.episodes) >= SIGNS_LEAST
    found = np.empty(count)
    for k in range(count):
        if k % ROUND == 0:
            spoilt = {kind: _spoil(screen, kind, generator) for kind in _KINDS}
        if whole and k % 2:
            flipped = [e.mirrored(generator.choice([-1.0, 1.0], 3)) for e in screen.episodes]
        else:
            episodes = spoilt[_KINDS[(k // 2 if whole else k) % len(_KINDS)]]
            flipped = [e.flipped(generator.choice([-1.0, 1.0], BLOCKS)) for e in episodes]
        found[k] = screen.best_gain(Grams.of(flipped))
    return found


_KINDS = ("signs", "time", "turn", "place")
ROUND = 40
"""Shams after which shift and order are drawn anew."""


def _spoil(screen: Screen, kind: str, generator: np.random.Generator) -> list[Whitened]:
    if kind == "signs":
        return screen.episodes
    kept = set(screen.base.tolist())
    return [_spoil_one(e, kind, kept, generator) for e in screen.episodes]


def _spoil_one(episode: Whitened, kind: str, kept: set[int], generator: np.random.Generator) -> Whitened:
    matrix = episode.matrix.copy()
    frames, patches = episode.shape
    shift = int(generator.integers(max(1, frames // 4), max(2, 3 * frames // 4)))
    order = generator.permutation(patches)
    for row in range(len(matrix)):
        if row in kept:
            continue
        field = matrix[row].reshape(frames, patches, 3)
        if kind == "time":
            field = np.roll(field, shift, 0)
        elif kind == "turn":
            field = np.stack([-field[..., 1], field[..., 0], field[..., 2]], -1)
        else:
            field = field[:, order]
        matrix[row] = field.ravel()
    return replace(episode, matrix=matrix)


def p_value(observed: float, shams: np.ndarray) -> float:
    """Chance of a best gain this large when nothing of the library is there: (1 + exceeding) / (1 + shams)."""
    return float((1 + (shams >= observed).sum()) / (1 + len(shams)))
