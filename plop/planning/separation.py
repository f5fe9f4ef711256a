"""Which motion distinguishes laws that are confounded, and how often it has to be recorded.

If law A is there at some amount, the expected log of how much more likely the evidence is with A than with the most
similar amount of B (Kullback & Leibler 1951) is

    D(A, B) = 1/2 min over s, a >= 0 of |R_A z - R_B (s + a z)|^2 in the metric of the inverse covariance.

The engine's responses are off by some share rho, so that rho^2 D(A, nothing) of it says nothing: a motion is as good as
the least of D(A, B) - rho^2 D(A, nothing) over all pairs (Hunter & Reiner, Technometrics 7, 1965; Box & Hill,
Technometrics 9, 1967). Whether a diagnosis would then call B worse is drawn, with the diagnosis's own rule, and with
the weights that it would find where A is there. What has been found in recordings stays; what is expected in the
reference changes with new ones, so that it is drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.decision.finding import gains_worse
from plop.diagnosis.evidence.contrast import roots
from plop.diagnosis.rule import RULE, DecisionRule
from plop.planning.design import DRAWS, Design


@dataclass(frozen=True)
class Pair:
    """A law that may be there, and another that may be taken for it."""

    truth: int
    """Column of the one that is there, at the amplitude of that hypothesis."""
    rival: int
    """Column of the other."""


def information(design: Design, pair: Pair, rule: DecisionRule = RULE) -> float:
    """Give what a pair is distinguished by, less what a wrong response could feign [nats]; see the module."""
    z = design.here.astype(float)
    there, both, rival = (
        design.gram[:, a, :, b] for a, b in ((pair.truth, pair.truth), (pair.rival, pair.truth), (pair.rival,) * 2)
    )
    basis = np.stack([z, np.ones(len(z))], 1) if not design.here.all() else z[:, None]
    whole, nothing = float(z @ there @ z), basis[:, 1:]
    left = whole - _explained(basis.T @ rival @ basis, basis.T @ both @ z)
    # without B something of A may be in the reference, too: only its change counts
    alone = whole - _explained(nothing.T @ there @ nothing, nothing.T @ there @ z)
    return float(0.5 * (left - rule.response_error**2 * alone))


def _explained(hessian: np.ndarray, pulled: np.ndarray) -> float:
    """Twice the log density that fitted amounts gain; a, the first of two, is not below 0."""
    if not len(pulled):
        return 0.0
    amounts = np.linalg.pinv(hessian, hermitian=True) @ pulled
    if len(pulled) > 1 and amounts[0] < 0:
        return _explained(hessian[1:, 1:], pulled[1:])
    return float(amounts @ pulled)


def least_information(design: Design, pairs: Sequence[Pair], rule: DecisionRule = RULE) -> float:
    """Give the information of the pair that is distinguished worst [nats]."""
    return min(information(design, pair, rule) for pair in pairs)


def settled_chance(
    designed: Callable[[int], Design],
    pairs: Sequence[Pair],
    found: Mapping[int, np.ndarray] = {},
    rule: DecisionRule = RULE,
) -> float:
    """Give the chance that a diagnosis calls all rivals worse than the law that is there, whichever that is: the least.

    Args:
        designed: Gives the recordings in which the law of a column is hidden.
        pairs: Laws and rivals.
        found: By column, gains of the first recordings, which have been diagnosed [nats].
        rule: Margins.
    """
    chances = []
    for truth in dict.fromkeys(pair.truth for pair in pairs):
        design = designed(truth)
        labels, amounts = design.here[None].astype(float), design.amounts(rule)
        rivals = [pair.rival for pair in pairs if pair.truth == truth]
        settled = 0
        for draw in range(DRAWS):
            drawn = {k: design.products(draw, k, truth, amounts[draw]).held_out(labels)[0][0] for k in (truth, *rivals)}
            compared = [_recorded(drawn, found, (truth, rival)) for rival in rivals]
            settled += all(
                own.sum() > 0 and (roots(other).sum() <= 0 or gains_worse(own, other, rule)) for own, other in compared
            )
        chances.append(settled / DRAWS)
    return min(chances)


def _recorded(
    drawn: Mapping[int, np.ndarray], found: Mapping[int, np.ndarray], columns: Sequence[int]
) -> list[np.ndarray]:
    """Put what was found in the first recordings in place of what is drawn, where it is known of all columns."""
    if not {*columns} <= found.keys():
        return [drawn[k] for k in columns]
    return [np.concatenate([found[k], drawn[k][len(found[k]) :]]) for k in columns]
