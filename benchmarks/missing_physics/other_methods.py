"""What simpler methods make of the same evidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.responses.hypotheses import Hypothesis

_THRESHOLD = 0.1
"""Share of the largest contribution below which sparse regression drops a column."""


def other_methods(found: Conclusion) -> dict[str, Any]:
    """Forward selection by BIC, sparse regression (sequential thresholding, as in SINDy), and all columns at once.

    All work on the same whitened residuals and responses, in-sample, without permutations, reference or held-out
    episodes; the last one stands for a learned residual: it lowers the error and names nothing.
    """
    search = found.search
    firsts: dict[str, Hypothesis] = {}
    for hypothesis in search.first:
        firsts.setdefault(hypothesis.candidate.key, hypothesis)
    effects = [hypothesis.effect for hypothesis in firsts.values()]
    responses = [search.response(hypothesis) for hypothesis in firsts.values()]
    scale = [np.sqrt(w)[:, None] for w in search.field.noise.weights]
    here = np.flatnonzero(search.here)
    residual = np.concatenate([(scale[k] * search.evidence[k].residual.reshape(-1, 3)).ravel() for k in here])
    columns = np.stack(
        [np.concatenate([(scale[k] * own[k].reshape(-1, 3)).ravel() for k in here]) for own in responses]
    )
    hessian, gradient, energy = columns @ columns.T, columns @ residual, float(residual @ residual)
    chosen = _bic(hessian, gradient, energy, residual.size)
    sparse = _thresholded(hessian, gradient)
    full = energy - float(gradient @ _solved(hessian + 1e-3 * np.diag(np.diag(hessian)), gradient))
    return {
        "bic": list(dict.fromkeys(effects[k] for k in chosen)),
        "sparse": list(dict.fromkeys(effects[k] for k in sparse)),
        "correlation": [effects[int(np.argmax(np.abs(gradient) / np.sqrt(np.maximum(np.diag(hessian), 1e-300))))]],
        "residual_error_share": full / energy,
    }


def _solved(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Least squares of smallest length: columns may be multiples of each other."""
    return np.asarray(np.linalg.lstsq(hessian, gradient, rcond=1e-10)[0])


def _bic(hessian: np.ndarray, gradient: np.ndarray, energy: float, numbers: int) -> list[int]:
    chosen: list[int] = []
    best = numbers * np.log(energy / numbers)
    while len(chosen) < len(gradient):
        trials = {}
        for k in set(range(len(gradient))) - set(chosen):
            rows = [*chosen, k]
            left = energy - float(gradient[rows] @ _solved(hessian[np.ix_(rows, rows)], gradient[rows]))
            trials[k] = numbers * np.log(max(left, 1e-12) / numbers) + len(rows) * np.log(numbers)
        k = min(trials, key=trials.__getitem__)
        if trials[k] >= best:
            break
        best, chosen = trials[k], [*chosen, k]
    return chosen


def _thresholded(hessian: np.ndarray, gradient: np.ndarray) -> list[int]:
    rows = list(np.flatnonzero(np.diag(hessian) > 0))
    for _ in range(10):
        values = _solved(hessian[np.ix_(rows, rows)], gradient[rows])
        size = np.abs(values) * np.sqrt(np.diag(hessian)[rows])
        keep = [row for row, s in zip(rows, size, strict=True) if s > _THRESHOLD * size.max()]
        if keep == rows:
            break
        rows = keep
    order = np.argsort(-size)
    return [rows[k] for k in order]
