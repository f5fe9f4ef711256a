"""Several amplitudes of one law, looked for together: what they do is not the sum of what each does alone.

A sideways pull shows how far an object slides, and which way, once it slides: where a pull along x or y alone leaves it
lying, both together may carry it off. Responses along the axes, added up, then point the wrong way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from plop.diagnosis.candidates import Column
from plop.diagnosis.responses import Settings

_STEP = 0.1
"""Finite difference of an amplitude, as a share of the one at which its response was first computed [-]."""
_RING = 2.0
"""Where a direction is looked for, in units of the amplitude at which the response was first computed [-]."""
_HALVINGS = 4
"""How often the start is halved; the least error of all begins the search."""
_MOST_STEPS = 12
_ENOUGH = 0.01
"""The search ends where a step changes error or amplitudes by less than this share."""
Left = Callable[[Sequence[Settings]], list[np.ndarray | None]]
"""Whitened residuals with a law at some amplitudes, [D] each; None where a run is unstable."""


def least_together(
    columns: Sequence[Column], start: np.ndarray, left: Left, others: Sequence[np.ndarray] = ()
) -> np.ndarray:
    """Find the amplitudes of least squared residual: Gauss-Newton in a trust region (Branch, Coleman & Li 1999).

    Args:
        columns: Of one law or of several; their values tell which changes can be seen.
        start: First guess [C], for example of a fit to the sum of the columns' responses.
        left: Runs the engine.
        others: More places where the search may begin, [C] each.

    Returns:
        Shape [C], each in its range; the start where all runs are unstable.
    """
    search = _Search(columns, left)
    tried = [np.clip(place, search.low, search.high) for place in (*(start / 2**k for k in range(_HALVINGS)), *others)]
    known = [(float(r @ r), k) for k, r in enumerate(search.residuals(tried)) if r is not None]
    if not known:
        return np.asarray(start)
    first = tried[min(known)[1]]
    inside = np.clip(first, search.low + 1e-6 * search.span, search.high - 1e-6 * search.span)
    found = least_squares(
        search.residual,
        inside,
        search.jacobian,
        (search.low, search.high),
        x_scale=search.steps,
        max_nfev=_MOST_STEPS,
        ftol=_ENOUGH,
        xtol=_ENOUGH,
        gtol=None,
    )
    return np.asarray(found.x)


def looked_around(columns: Sequence[Column], left: Left) -> np.ndarray | None:
    """Find the amplitudes of least squared residual, in whatever direction they lie.

    Args:
        columns: Of one law; their values say how large an amplitude can be seen.
        left: Runs the engine.

    Returns:
        Shape [C]; None where the law makes nothing better in any direction in which it was tried.
    """
    search = _Search(columns, left)
    tried = [
        np.clip(_RING * direction * search.steps / _STEP, search.low, search.high)
        for direction in directions(len(columns))
    ]
    none, *around = search.residuals([np.zeros(len(columns)), *tried])
    known = [(float(r @ r), k) for k, r in enumerate(around) if r is not None]
    if none is None or not known or min(known)[0] >= float(none @ none):
        return None
    return least_together(columns, tried[min(known)[1]], left)


def directions(count: int) -> list[np.ndarray]:
    """Give all combinations of forward, not at all and backward; of more than two amplitudes one at a time."""
    if count > 2:
        return [sign * axis for axis in np.eye(count) for sign in (1.0, -1.0)]
    return [np.array(signs) for signs in product((-1.0, 0.0, 1.0), repeat=count) if any(signs)]


class _Search:
    """Residuals and their derivatives; what was run once is remembered."""

    def __init__(self, columns: Sequence[Column], left: Left) -> None:
        self.columns, self.left = columns, left
        self.low, self.high = (np.array(ends) for ends in zip(*((c.low, c.high) for c in columns), strict=True))
        self.span = self.high - self.low
        self.steps = np.array([_STEP * abs(c.value) for c in columns])
        self.known: dict[tuple[float, ...], np.ndarray | None] = {}

    def residuals(self, places: Sequence[np.ndarray]) -> list[np.ndarray | None]:
        """Residuals at some amplitudes [C] each."""
        new = [place for key, place in {tuple(place): place for place in places}.items() if key not in self.known]
        settings = [tuple(zip(self.columns, place.tolist(), strict=True)) for place in new]
        self.known |= {tuple(place): r for place, r in zip(new, self.left(settings), strict=True)} if new else {}
        return [self.known[tuple(place)] for place in places]

    def residual(self, place: np.ndarray) -> np.ndarray:
        """The same at one place; where the engine is unstable, far worse than anything that was seen."""
        (found,) = self.residuals([place])
        if found is None:
            return 2 * max((r for r in self.known.values() if r is not None), key=lambda r: float(r @ r))
        return found

    def jacobian(self, place: np.ndarray) -> np.ndarray:
        """Derivatives by differences towards the middle of the range, [D, C]; 0 where a run is unstable."""
        middle = (self.low + self.high) / 2
        steps = np.where(place > middle, -self.steps, self.steps)
        here, *moved = self.residuals([place, *(place + step for step in np.diag(steps))])
        if here is None:
            return np.zeros((len(self.residual(place)), len(steps)))
        return np.stack(
            [
                np.zeros_like(here) if there is None else (there - here) / step
                for there, step in zip(moved, steps, strict=True)
            ],
            1,
        )
