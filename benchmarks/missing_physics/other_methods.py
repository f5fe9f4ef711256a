"""What simpler methods make of the same evidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from plop.diagnosis.conclusion import Diagnosis
from plop.diagnosis.evidence import whiten
from plop.diagnosis.regression import Grams, solve

_THRESHOLD = 0.1
"""Share of the largest contribution below which sparse regression drops a column."""


def other_methods(found: Diagnosis) -> dict[str, Any]:
    """Forward selection by BIC, sparse regression (sequential thresholding, as in SINDy), and all columns at once.

    All work on the same whitened residuals and responses, in-sample, without permutations, reference or held-out
    episodes; the last one stands for a learned residual: it lowers the error and names nothing.
    """
    keys = [column.key for score in found.scores for column in score.candidate.columns]
    effects = [score.candidate.effect for score in found.scores for _ in score.candidate.columns]
    grams = Grams.of([whiten(e, found.misfit, keys) for e in found.evidence])
    hessian, gradient, energy = grams.hessian.sum(0), grams.gradient.sum(0), float(grams.energy.sum())
    numbers = sum(e.residual.size for e in found.evidence)
    chosen = _bic(hessian, gradient, energy, numbers)
    sparse = _thresholded(hessian, gradient)
    full = energy - float(gradient @ solve(hessian + 1e-3 * np.diag(np.diag(hessian)), gradient))
    return {
        "bic": list(dict.fromkeys(effects[k] for k in chosen)),
        "sparse": list(dict.fromkeys(effects[k] for k in sparse)),
        "residual_error_share": full / energy,
    }


def _bic(hessian: np.ndarray, gradient: np.ndarray, energy: float, numbers: int) -> list[int]:
    chosen: list[int] = []
    best = numbers * np.log(energy / numbers)
    while len(chosen) < len(gradient):
        trials = {}
        for k in set(range(len(gradient))) - set(chosen):
            rows = [*chosen, k]
            left = energy - float(gradient[rows] @ solve(hessian[np.ix_(rows, rows)], gradient[rows]))
            trials[k] = numbers * np.log(max(left, 1e-12) / numbers) + len(rows) * np.log(numbers)
        k = min(trials, key=trials.__getitem__)
        if trials[k] >= best:
            break
        best, chosen = trials[k], [*chosen, k]
    return chosen


def _thresholded(hessian: np.ndarray, gradient: np.ndarray) -> list[int]:
    rows = list(np.flatnonzero(np.diag(hessian) > 0))
    for _ in range(10):
        values = solve(hessian[np.ix_(rows, rows)], gradient[rows])
        size = np.abs(values) * np.sqrt(np.diag(hessian)[rows])
        keep = [row for row, s in zip(rows, size, strict=True) if s > _THRESHOLD * size.max()]
        if keep == rows:
            break
        rows = keep
    order = np.argsort(-size)
    return [rows[k] for k in order]
