"""Is anything else in the recordings than in the reference, whatever it is, and how much of it does a law explain?

The most general hypothesis: a smooth field of displacements over place, tool-relative place and phase that is the same
in all episodes to explain, and not in the reference. It is fitted and held out as a law is. What it holds is what a law
of the library could at best explain; what is left of it with a law is what no law explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.evidence.discrepancy import Field

_AT_ONCE = 200
_SINGULAR = 1e-9


@dataclass(frozen=True)
class Unknown:
    """Products of the field's columns and the residuals, see `Field.multiplied`."""

    gram: np.ndarray
    """[E, X, E, X]."""
    onto: np.ndarray
    """[E, X]."""

    @classmethod
    def of(cls, field: Field, residuals: Sequence[np.ndarray]) -> Unknown:
        """Ask what residuals [F, K, 3] [m] of each episode hold."""
        return cls(*field.multiplied(field.unknown, residuals))

    def evidence(self, labels: np.ndarray) -> np.ndarray:
        """Log of how much more likely the residuals are with such a field, for ways of dealing out [N, E], [N]."""
        wide = self.onto.shape[1]
        found = []
        for part in np.array_split(labels, max(1, -(-len(labels) // _AT_ONCE))):
            pulled = np.tensordot(part, self.gram, (1, 0))  # N, X, E, X
            precision = np.einsum("nxey,ne->nxy", pulled, part, optimize=True) + np.eye(wide)
            onto = part @ self.onto
            solved = np.linalg.solve(precision, onto[..., None])[..., 0]
            found.append(0.5 * (onto * solved).sum(1) - 0.5 * np.linalg.slogdet(precision)[1])
        return np.concatenate(found)

    def held_out(self, here: np.ndarray) -> np.ndarray:
        """Gain of log density of each episode to explain, the field fitted to all others, [H] [nats]."""
        z, wide = here.astype(float), self.onto.shape[1]
        rows = np.tensordot(self.gram, z, (2, 0))  # E, X, X: what the field in all episodes does in each
        precision, onto = np.tensordot(z, rows, 1) + np.eye(wide), z @ self.onto
        gains = []
        for e in np.flatnonzero(here).tolist():
            own = self._own(e)
            # the episode is not there: its part of the covariance is taken out (Schur's complement)
            kept = precision - rows[e].T @ own @ rows[e]
            weights = np.linalg.solve(kept, onto - rows[e].T @ own @ self.onto[e])
            left = self.onto[e] - rows[e] @ weights
            gains.append(0.5 * float(self.onto[e] @ own @ self.onto[e] - left @ own @ left))
        return np.array(gains)

    def alone(self, here: np.ndarray) -> float:
        """Gain of log density in the episodes to explain by fields of their own, each fitted to itself [nats]."""
        return float(sum(0.5 * self.onto[e] @ self._own(e) @ self.onto[e] for e in np.flatnonzero(here).tolist()))

    def _own(self, e: int) -> np.ndarray:
        return np.asarray(np.linalg.pinv(self.gram[e, :, e], rcond=_SINGULAR, hermitian=True))
