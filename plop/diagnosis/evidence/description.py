"""What the recordings show that nothing explains: in which motions, when, where, and in which direction.

For a person who knows mechanics: a law is guessed from such facts. All are differences to the reference recordings, in
which the base errs, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.evidence.evidence import PATH_STEPS, Evidence
from plop.parameters import short_number

PARTS = ("first", "second", "last")
"""Thirds of a motion."""
_NEAR = 0.25
"""A patch this close to the tool's frame is near it [object sizes]."""
_MOVED = 0.05
"""The tool has a direction along the table once it is so far from where it started [object sizes]."""
_LITTLE = 0.05
"""A share of what is there that is taken for none."""
_PLAIN = 1.5
"""How many times more there has to be of it at one place, or time, than elsewhere to be told."""


@dataclass(frozen=True)
class Shown:
    """Mean error of one part of the evidence [mm]; a part that breaks loose weighs less than in a mean square."""

    what: str
    here_mm: float
    reference_mm: float

    @property
    def excess(self) -> float:
        """How much more there is than in the reference, as errors that are independent add up [mm^2]."""
        more = self.here_mm**2 - self.reference_mm**2
        return more if more > _LITTLE * self.here_mm**2 else 0.0


@dataclass(frozen=True)
class Description:
    """What differs from the reference; displacements are measured minus predicted, means over the episodes."""

    motions: tuple[Shown, ...]
    """By kind of motion, what shows it most first."""
    times: tuple[Shown, ...]
    """By thirds of the motion."""
    near_tool: Shown
    away_from_tool: Shown
    upper: Shown
    lower: Shown
    up_mm: float
    """Upwards."""
    along_mm: float | None
    """Along the tool's way over the table, so that it changes its sign with it; None where no tool moves aside."""
    fixed_mm: float
    """Along the table in the direction in which it is largest, the same in all motions."""


def describe(
    left: Sequence[np.ndarray], evidence: Sequence[Evidence], kinds: Sequence[str], here: np.ndarray
) -> Description:
    """Describe residuals.

    Args:
        left: Residuals [F, K, 3] [m] of every episode.
        evidence: Of the same.
        kinds: Kind of motion of each.
        here: Which are to be explained, bool [E].
    """

    def shown(what: str, masks: Sequence[np.ndarray]) -> Shown:
        sizes = []
        for label in (True, False):
            each = zip(left, masks, evidence, here, strict=True)
            norms = [np.linalg.norm(r, axis=-1)[m & e.seen] for r, m, e, h in each if h == label]
            together = np.concatenate(norms) if norms else np.zeros(0)
            sizes.append(1000 * float(together.mean() if len(together) else 0.0))
        return Shown(what, *sizes)

    everywhere = [np.ones_like(e.seen) for e in evidence]
    motions = [
        shown(kind, [m & (own == kind) for m, own in zip(everywhere, kinds, strict=True)])
        for kind in dict.fromkeys(kinds)
    ]
    thirds = [
        shown(
            name,
            [
                m & (np.minimum((3 * e.phase).astype(int), 2) == k)[:, None]
                for m, e in zip(everywhere, evidence, strict=True)
            ],
        )
        for k, name in enumerate(PARTS)
    ]
    near = [np.linalg.norm(e.tool_place, axis=-1) < _NEAR for e in evidence]
    high = [m & (e.place[:, 2] > np.median(e.place[:, 2])) for m, e in zip(everywhere, evidence, strict=True)]
    means = [_means(r, e) for r, e, h in zip(left, evidence, here, strict=True) if h and e.seen.any()]
    along = [m[3] for m in means if np.isfinite(m[3])]
    mean = np.mean([m[:3] for m in means], 0)
    return Description(
        tuple(sorted(motions, key=lambda s: -s.excess)),
        tuple(thirds),
        shown("near the tool", near),
        shown("away from the tool", [~m for m in near]),
        shown("in the upper half", high),
        shown("in the lower half", [~m for m in high]),
        1000 * float(mean[2]),
        1000 * float(np.mean(along)) if along else None,
        1000 * float(np.hypot(*mean[:2])),
    )


def _means(left: np.ndarray, evidence: Evidence) -> np.ndarray:
    """Mean residual of an episode along x, y, z and along the tool's way over the table, [4] [m]; NaN without a way."""
    seen = evidence.seen
    middle = evidence.tool_path.mean(1)
    steps = np.round(evidence.phase * (PATH_STEPS - 1)).astype(int)
    way = (middle[steps] - middle[0])[:, :2]
    far = np.linalg.norm(way, axis=-1)
    use = seen & (far > _MOVED)[:, None]
    direction = way / np.maximum(far, 1e-9)[:, None]
    along = np.einsum("fkx,fx->fk", left[..., :2], direction)
    return np.array([*left[seen].mean(0), along[use].mean() if use.any() else np.nan])


def description_text(found: Description) -> str:
    """Write the facts that stand out."""
    parts = []
    motions = [m for m in found.motions if m.excess > 0]
    if motions and len(found.motions) > 1:
        first = motions[0]
        parts.append(f"most in {first.what} ({_mm(first.here_mm)} mm for {_mm(first.reference_mm)} in the reference)")
    late = max(found.times, key=lambda s: s.excess)
    if late.excess > _PLAIN * sorted(s.excess for s in found.times)[1]:
        parts.append(f"in the {late.what} third of the motion")
    for one, other in ((found.near_tool, found.away_from_tool), (found.upper, found.lower)):
        more, less = (one, other) if one.excess >= other.excess else (other, one)
        if more.excess > _PLAIN * less.excess:
            parts.append(more.what)
    moved = [f"{_mm(abs(found.up_mm))} mm {'higher' if found.up_mm > 0 else 'lower'}"]
    if found.along_mm is not None:
        how = "farther along" if found.along_mm > 0 else "less far along"
        moved.append(f"{_mm(abs(found.along_mm))} mm {how} the tool's way over the table")
    moved.append(f"{_mm(found.fixed_mm)} mm to one side in all motions alike")
    where = f" It shows {', '.join(parts)}." if parts else ""
    return f"{where} On average the object is {', '.join(moved)} than the base predicts."


def _mm(value: float) -> str:
    return short_number(round(value, 3))
