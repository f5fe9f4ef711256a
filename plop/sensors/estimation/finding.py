"""Which sensor faults the fit of a camera calls for, and how sure that is.

All further reasoning works on the fit's parameters and their covariance alone: the misfit of any hypothesis that
leaves parameters at 'absent' follows from them (Wald, Trans. AMS 54, 1943), and so does the estimate under it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2, norm

from plop.sensors.estimation.fit import CameraFit
from plop.sensors.estimation.parameters import ABSENT, COUNT, SLICES
from plop.sensors.faults.library import FAULTS

MIN_Z = 4.0
"""A fault is significant beyond this many standard errors."""
MIN_EFFECT_M = 2e-4
"""It matters when it moves the object's points by more than this: a tenth of the largest usual noise, 2 mm [m]."""
MIN_POSE_EFFECT_M = 5e-4
"""The same for the faults with six parameters: these take up what is not quite right in tool and table as well, and
were 0.2 mm off, many standard errors by the residuals, in recordings that were rendered without any fault [m]."""
NOISE_SHARE = 0.1
"""... and by more than this share of the measured noise of a depth pixel."""
COST_PER_PARAMETER = 12.0
"""Chi-square that a further parameter must bring when faults of one number and of six compete."""
AS_GOOD = 9.0
"""Another fault that loses less than this chi-square explains the data as well."""


@dataclass(frozen=True)
class Viewed:
    """What turns parameters into motion of the object's points."""

    middle_cam: np.ndarray
    """Middle of the object in the camera's axes, shape [3] [m]."""
    reach_m: float
    """Half the object's diagonal [m]."""
    tool_speed_m_s: float
    """Root mean square speed of the tool [m/s]."""


@dataclass(frozen=True)
class FaultEstimate:
    """One fault of one camera."""

    fault: str
    values: dict[str, float]
    """Parameter -> value, in the fault's own units."""
    standard_errors: dict[str, float]
    z: float
    """Significance of all its parameters together, as standard errors of a normal."""
    effect_m: float
    """By how much it moves the object's points: at the episode's end for a drift [m]."""
    tolerance_m: float
    """Effect below which it does not matter [m]."""
    found: bool
    """Significant and beyond the tolerance."""
    alternatives: tuple[str, ...] = ()
    """Faults that would explain the data as well: they cannot be told apart here."""


@dataclass(frozen=True)
class SensorFinding:
    """What is known of one camera, from one episode or from several."""

    camera: str
    faults: tuple[FaultEstimate, ...]
    """All faults of the library; one that was not found is estimated beside those that were."""
    fit: CameraFit
    viewed: Viewed

    @property
    def found(self) -> list[FaultEstimate]:
        """The faults that are significant and matter."""
        return [each for each in self.faults if each.found]

    def as_dict(self) -> dict[str, Any]:
        """Give what a person wants to see, for JSON."""
        return {
            "camera": self.camera,
            "noise_m": self.fit.noise_m,
            "residuals": dict(self.fit.counts),
            "faults": [asdict(each) for each in self.faults],
        }


def judge(camera: str, fit: CameraFit, viewed: Viewed) -> SensorFinding:
    """Choose the fewest faults that explain what was fitted.

    Faults are added while one is significant, that which gains most chi-square for its parameters first, and
    dropped again when the others make them needless.
    """
    evidence = _Evidence(fit)
    chosen = _choose(evidence)
    together = joint_effect_m(chosen, evidence.estimate(chosen)[0], viewed)
    estimates = []
    for name in FAULTS:
        among = chosen if name in chosen else [*chosen, name]
        values, covariance = evidence.estimate(among)
        part = SLICES[name]
        least = MIN_POSE_EFFECT_M if name in ("pose_error", "pose_drift") else MIN_EFFECT_M
        tolerance = max(least, NOISE_SHARE * fit.noise_m)
        z = evidence.z(among, name)
        effect = effect_m(name, values[part], viewed)
        others = tuple(
            o
            for o in FAULTS
            if o not in chosen
            and evidence.gain(chosen) - evidence.gain([o if c == name else c for c in chosen]) < AS_GOOD
        )
        keys = [p.name for p in FAULTS[name].parameters]
        found = name in chosen and z > MIN_Z and min(effect, together) > tolerance
        estimates.append(
            FaultEstimate(
                name,
                dict(zip(keys, (ABSENT + values)[part].tolist(), strict=True)),
                dict(zip(keys, np.sqrt(np.diag(covariance)[part]).tolist(), strict=True)),
                z,
                effect,
                tolerance,
                found,
                others if found else (),
            )
        )
    return SensorFinding(camera, tuple(estimates), fit, viewed)


def effect_m(fault: str, deviation: np.ndarray, viewed: Viewed) -> float:
    """Root mean square motion of the object's points under a fault [m]; the tool's speed stands for the object's."""
    if fault == "clock":
        return float(abs(deviation[0]) * viewed.tool_speed_m_s)
    return float(np.sqrt((_motion(fault, deviation, viewed) ** 2).sum(1).mean()))


def joint_effect_m(chosen: list[str], values: np.ndarray, viewed: Viewed) -> float:
    """The same for several faults at once: a scale and a shift along the axis may cancel on the object [m].

    Args:
        chosen: The faults.
        values: Their parameters as deviations from none [15].
        viewed: What turns them into motion.
    """
    motions = [_motion(name, values[SLICES[name]], viewed) for name in chosen if name != "clock"]
    still = float(np.sqrt((np.sum(motions, axis=0) ** 2).sum(-1).mean())) if motions else 0.0
    return float(np.hypot(still, effect_m("clock", values[SLICES["clock"]], viewed) if "clock" in chosen else 0.0))


def _motion(fault: str, deviation: np.ndarray, viewed: Viewed) -> np.ndarray:
    """Motion of points about the object under a fault that is not the clock's, in the camera's axes [6, 3] [m]."""
    around = viewed.middle_cam + 0.6 * viewed.reach_m * np.concatenate([np.eye(3), -np.eye(3)])
    if fault == "depth_scale":
        return np.asarray(deviation[0] * around)
    if fault == "depth_bias":
        return np.asarray(deviation[0] * around / around[:, 2:])
    return np.asarray(-deviation[:3] + np.cross(around, deviation[3:]))


class _Evidence:
    """Quadratic misfit around the fit."""

    def __init__(self, fit: CameraFit) -> None:
        self.information = np.linalg.inv(fit.covariance)
        self.pull = self.information @ fit.deviation

    def estimate(self, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Best parameters [15] and covariance [15, 15] when only these faults exist."""
        values, covariance = np.zeros(COUNT), np.zeros((COUNT, COUNT))
        if names:
            index = np.r_[tuple(SLICES[name] for name in names)]
            part = np.linalg.inv(self.information[np.ix_(index, index)])
            values[index], covariance[np.ix_(index, index)] = part @ self.pull[index], part
        return values, covariance

    def gain(self, names: list[str]) -> float:
        """Chi-square that these faults explain."""
        return float(self.estimate(names)[0] @ self.pull)

    def added(self, names: list[str], name: str) -> float:
        """Chi-square that `name` brings to the others in `names`."""
        return self.gain(names) - self.gain([other for other in names if other != name])

    def z(self, names: list[str], name: str) -> float:
        """The same as the number of standard errors of a normal with equal probability."""
        size = max(self.added(names, name), 0.0)
        count = len(FAULTS[name].parameters)
        if count == 1:
            return float(np.sqrt(size))
        return float(norm.isf(np.exp(chi2.logsf(size, count)) / 2)) if size < 1000 else float(np.sqrt(size - count))


def _choose(evidence: _Evidence) -> list[str]:
    chosen: list[str] = []
    for _ in range(2 * len(FAULTS)):
        open_ = [n for n in FAULTS if n not in chosen and evidence.z([*chosen, n], n) > MIN_Z]
        if not open_:
            break
        chosen.append(
            max(open_, key=lambda n: evidence.added([*chosen, n], n) - COST_PER_PARAMETER * len(FAULTS[n].parameters))
        )
        chosen = [n for n in chosen if evidence.z(chosen, n) > MIN_Z]
    return chosen
