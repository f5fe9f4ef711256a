"""Which sensor faults the evidence calls for: by how far they displace the object, all parameters together.

One rule: a camera is right while parameters that displace the object by no more than a tolerance lie within SURE
standard errors of what was fitted. If there are none, the fewest faults are named without which the rest would not be
within the tolerance either, and each must show in most episodes that could: the rig is the same in all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import reduce
from itertools import combinations
from operator import add
from typing import Any

import numpy as np

from plop.sensors.estimation.displacement import Displacement, misfit
from plop.sensors.estimation.fit import CameraFit, Evidence
from plop.sensors.estimation.parameters import ABSENT, COUNT, SLICES, TOTAL
from plop.sensors.estimation.residuals import PIXEL_ERROR
from plop.sensors.faults.library import FAULTS

SURE = 4.0
"""Standard errors beyond which a fault is significant."""
HALF = 0.5
"""An episode shows a fault of which it has more than so much, if its standard error is less."""


class State(StrEnum):
    """What is known of a camera."""

    RIGHT = "right"
    FAULTY = "faulty"
    CANNOT_BE_JUDGED = "cannot be judged"
    """It is not known to a pixel where it sees the object's points, or its episodes do not agree."""


@dataclass(frozen=True)
class FaultEstimate:
    """One fault of one camera."""

    fault: str
    values: dict[str, float]
    """Parameter -> value, in the fault's own units."""
    standard_errors: dict[str, float]
    z: float
    """Standard errors by which the object is displaced beyond the tolerance without this fault."""
    effect_m: float
    """By how much it displaces the object's points, root mean square over points and frames [m]."""
    episodes: int
    """Episodes that show it, each by itself."""
    found: bool
    alternatives: tuple[str, ...] = ()
    """Faults that would explain the data as well: they cannot be told apart here."""


@dataclass(frozen=True)
class Episode:
    """What one camera says in one episode."""

    fit: CameraFit
    displacement: Displacement


@dataclass(frozen=True)
class SensorFinding:
    """What is known of one camera, from one episode or from several."""

    camera: str
    state: State
    faults: tuple[FaultEstimate, ...]
    """All faults of the library; one that was not found is estimated beside those that were."""
    tolerance_m: float
    """Displacement of the object that does not matter: what a pixel rounds, sideways and in depth [m]."""
    unsure_m: float
    """Standard error of the object's displacement, in the direction that is known least [m]."""
    episodes: tuple[Episode, ...]

    @property
    def found(self) -> list[FaultEstimate]:
        """The faults that are significant and matter."""
        return [each for each in self.faults if each.found]

    @property
    def noise_m(self) -> float:
        """Noise of one depth pixel, in the median episode [m]."""
        return float(np.median([each.fit.noise_m for each in self.episodes]))

    def as_dict(self) -> dict[str, Any]:
        """Give what a person wants to see, for JSON."""
        counts = [each.fit.counts for each in self.episodes]
        return {
            "camera": self.camera,
            "state": self.state,
            "noise_m": self.noise_m,
            "tolerance_m": self.tolerance_m,
            "unsure_m": self.unsure_m,
            "residuals": {kind: sum(each[kind] for each in counts) for kind in counts[0]},
            "faults": [asdict(each) for each in self.faults],
        }


def judge(camera: str, episodes: Sequence[Episode]) -> SensorFinding:
    """Choose the fewest faults that explain what was fitted in the episodes of one rig."""
    case = _Case(episodes)
    chosen = case.choose()
    estimates = tuple(case.estimate(name, chosen) for name in FAULTS)
    unsure = case.unsure_m()
    if any(each.found for each in estimates):
        state = State.FAULTY
    else:
        state = State.RIGHT if unsure < case.resolved_m and not chosen else State.CANNOT_BE_JUDGED
    return SensorFinding(camera, state, estimates, case.tolerance_m, unsure, tuple(episodes))


def agreed(able: np.ndarray, episodes: int) -> bool:
    """Tell whether most episodes that could show a fault do, and not one alone of several.

    Args:
        able: Amplitudes of the fault in those that could, 1 being the pooled one.
        episodes: Number of all episodes.
    """
    shown = int((able > HALF).sum())
    return shown > len(able) / 2 and shown >= min(2, episodes)


def _basis(names: Sequence[str]) -> np.ndarray:
    return np.eye(TOTAL)[:, np.r_[tuple(SLICES[name] for name in names)]] if names else np.zeros((TOTAL, 0))


class _Case:
    """The evidence of some episodes together."""

    def __init__(self, episodes: Sequence[Episode]) -> None:
        self.each = [episode.fit.evidence for episode in episodes]
        self.all: Evidence = reduce(add, self.each)
        self.motion = np.mean([episode.displacement.squared for episode in episodes], axis=0)
        sizes = [np.hypot(episode.displacement.pixel_m, episode.fit.noise_m) for episode in episodes]
        self.resolved_m = float(np.median(sizes))
        self.tolerance_m = PIXEL_ERROR * self.resolved_m
        self.values, self.covariance = self.all.about(np.eye(TOTAL)[:, :COUNT])

    def unsure_m(self) -> float:
        """Give the largest standard error of a displacement [m]."""
        root = np.linalg.cholesky(self.covariance)
        return float(np.sqrt(np.linalg.eigvalsh(root.T @ self.motion[:COUNT, :COUNT] @ root)[-1]))

    def misfit(self, names: Sequence[str]) -> float:
        """Give the misfit of 'nothing but these faults displaces the object'."""
        motion = self.motion[:COUNT, :COUNT].copy()
        for name in names:
            motion[SLICES[name]], motion[:, SLICES[name]] = 0, 0
        return misfit(self.values, self.covariance, motion, self.tolerance_m)

    def enough(self, names: Sequence[str]) -> bool:
        """Tell whether these faults suffice."""
        return self.misfit(names) < SURE**2

    def choose(self) -> list[str]:
        """Choose the fewest faults that suffice; of equally many, the fewest parameters, then the least misfit."""
        for count in range(len(FAULTS) + 1):
            sets = [list(names) for names in combinations(FAULTS, count) if self.enough(names)]
            if sets:
                return min(sets, key=lambda names: (_basis(names).shape[1], self.misfit(names)))
        raise AssertionError("all faults together always suffice")

    def estimate(self, name: str, chosen: list[str]) -> FaultEstimate:
        """Estimate a fault beside the chosen ones, and decide whether it is found."""
        others = [other for other in chosen if other != name]
        part = slice(0, SLICES[name].stop - SLICES[name].start)
        values, covariance = self.all.about(_basis([name, *others]))
        deviation = np.zeros(TOTAL)
        deviation[SLICES[name]] = values[part]
        able, wider = self.agreement(deviation, others) if name in chosen else (np.zeros(0), 1.0)
        z = float(np.sqrt(self.misfit(others))) / wider
        found = name in chosen and z > SURE and agreed(able, len(self.each))
        keys = [p.name for p in FAULTS[name].parameters]
        errors = wider * np.sqrt(np.diag(covariance)[part])
        return FaultEstimate(
            name,
            dict(zip(keys, (ABSENT + deviation)[SLICES[name]].tolist(), strict=True)),
            dict(zip(keys, errors.tolist(), strict=True)),
            z,
            float(np.sqrt(deviation @ self.motion @ deviation)),
            int((able > HALF).sum()),
            found,
            tuple(o for o in FAULTS if o not in chosen and self.enough([o, *others])) if found else (),
        )

    def agreement(self, deviation: np.ndarray, others: list[str]) -> tuple[np.ndarray, float]:
        """Ask every episode for its own amplitude of a fault, the pooled one being 1.

        Args:
            deviation: The fault [19].
            others: Faults that each episode may have besides.

        Returns:
            Amplitudes of the episodes that could distinguish 1 from 0 (by 2 standard errors); and how much wider
            standard errors are for the scatter (median absolute deviation) between these.
        """
        basis = np.c_[deviation, _basis(others)]
        each = [(values[0], np.sqrt(errors[0, 0])) for values, errors in (e.about(basis) for e in self.each)]
        able = np.array([amplitude for amplitude, error in each if error < HALF])
        if not len(able):
            return able, 1.0
        scatter = 1.4826 * np.median(np.abs(able - np.median(able))) / np.sqrt(len(able))
        return able, float(np.hypot(1.0, scatter / np.sqrt(self.all.about(basis)[1][0, 0])))
