"""Amounts of one or more responses in the recordings, fitted to what the evidence says of them; see `contrast`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.diagnosis.rule import RULE

SINGULAR = 1e-9
"""Of the largest, below which something tells nothing."""
_ROUNDS = 5
"""In which a mean amount and the spread around it are found from each other."""


@dataclass(frozen=True)
class Contrast:
    """Fitted amounts of K responses."""

    amounts: np.ndarray
    """a of each, [K]."""
    covariance: np.ndarray
    """That of the discrepancy model and that by the scatter of episodes (sandwich) together, [K, K]."""
    freedom: int
    """Degrees of freedom of the scatter."""

    @property
    def amount(self) -> float:
        """Amount of the first response."""
        return float(self.amounts[0])

    @property
    def error(self) -> float:
        """Its standard error."""
        return float(np.sqrt(self.covariance[0, 0]))


def contrast(
    gram: np.ndarray, onto: np.ndarray, here: np.ndarray, repeats: np.ndarray, scatter: float = 0.0
) -> Contrast:
    """Fit a and, where some episodes are a reference, s, of K responses at once by generalised least squares.

    Args:
        gram: Products of the responses, [E, K, E, K].
        onto: Products with the residuals, [E, K].
        here: Which episodes are to be explained, bool [E].
        repeats: 1 where two episodes repeat a motion, else 0, [E, E].
        scatter: Standard deviation of amounts between motions: the larger, the more nearly all count alike.
    """
    count, wide = onto.shape
    z = here.astype(float)
    design = np.kron(z[:, None] if here.all() else np.stack([z, np.ones(count)], 1), np.eye(wide))
    flat, pulled = gram.reshape(count * wide, count * wide), onto.reshape(-1)
    if not _regular(design.T @ flat @ design):
        return Contrast(np.zeros(wide), np.full((wide, wide), np.inf), 1)
    # covariance of the products where amounts differ: G + G T G
    weighted = design.T @ np.linalg.inv(np.eye(count * wide) + scatter**2 * flat @ np.kron(repeats, np.eye(wide)))
    inverse = np.linalg.inv(weighted @ flat @ design)
    fitted = inverse @ weighted @ pulled
    pulls = (inverse[:wide] @ weighted) * (pulled - flat @ design @ fitted)
    by_episode = pulls.reshape(wide, count, wide).sum(2)
    freedom = max(count - design.shape[1] // wide, 1)
    covariance = inverse[:wide, :wide] + by_episode @ by_episode.T * count / freedom
    return Contrast(fitted[:wide], covariance, freedom)


def typical(gram: np.ndarray, onto: np.ndarray, here: np.ndarray, repeats: np.ndarray) -> Contrast:
    """Fit mean amounts of K responses that scatter in proportion to how much there is (DerSimonian & Laird 1986).

    Args:
        gram: Products of the responses, [E, K, E, K].
        onto: Products with the residuals, [E, K].
        here: Which episodes are to be explained, bool [E].
        repeats: 1 where two episodes repeat a motion, else 0, [E, E].
    """
    found = contrast(gram, onto, here, repeats, RULE.response_error)
    for _ in range(_ROUNDS):
        much = float(np.linalg.norm(found.amounts)) if found.amount > 0 else 0.0
        found = contrast(gram, onto, here, repeats, RULE.response_error * much)
    return found


def _regular(hessian: np.ndarray) -> bool:
    values = np.linalg.eigvalsh(hessian)
    return bool(values[-1] > 0 and values[0] > SINGULAR * values[-1])


def own_amounts(gram: np.ndarray, onto: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Fit how much each episode to explain shows of several responses by itself, beyond what all episodes show.

    The responses are those of one law in all its settings: what a law does is in proportion to none of them where it is
    strong, or where the engine errs from motion to motion. They resemble each other, and there are as many amounts as
    episodes, so that all have a normal prior with the amplitude at which a response was computed as its scale (ridge
    regression).

    Args:
        gram: Products of K responses, [E, K, E, K].
        onto: Products with the residuals, [E, K].
        here: Which episodes are to be explained, bool [E].

    Returns:
        Amounts, [E, K]; 0 in the reference.
    """
    (count, wide), each = onto.shape, np.flatnonzero(here)
    # [E, X]: the amounts of every episode to explain, then, where there is a reference, what is in all of them
    common = np.zeros((count, 0)) if here.all() else np.ones((count, 1))
    design = np.kron(np.concatenate([np.eye(count)[:, each], common], 1), np.eye(wide))
    normal = design.T @ gram.reshape(count * wide, count * wide) @ design
    fitted = np.linalg.solve(normal + np.eye(len(normal)), design.T @ onto.reshape(-1))
    found = np.zeros((count, wide))
    found[each] = fitted[: len(each) * wide].reshape(-1, wide)
    return found
