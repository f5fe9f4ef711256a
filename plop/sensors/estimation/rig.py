"""The cameras of a rig together: what they share is the tool's fault, or the robot's clock's.

The same rule as for one camera: the fewest faults. One fault of the tool is assumed when the cameras need fewer by more
than that one once it is put right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.sensors.estimation.finding import HALF, Episode, FaultEstimate, SensorFinding, agreed, judge
from plop.sensors.estimation.fit import Evidence
from plop.sensors.estimation.parameters import SLICES, TOTAL
from plop.sensors.faults.tool import TOOL_FAULTS

ROUNDS = 10
"""Rounds in which cameras that disagree lose weight."""


@dataclass(frozen=True)
class Rig:
    """What is known of the tool and of all cameras."""

    tool: FaultEstimate | None
    """What is wrong with the tool, in the eyes of all cameras."""
    cameras: tuple[SensorFinding, ...]
    """One finding per camera, in the order of their names; with the tool's fault put right."""


def judge_rig(cameras: Mapping[str, Sequence[Episode]]) -> Rig:
    """Judge every camera, alone and with each fault of the tool put right.

    Args:
        cameras: The episodes of each.
    """
    alone = Rig(None, tuple(judge(camera, episodes) for camera, episodes in sorted(cameras.items())))
    if _size(alone) < 2:
        return alone
    rigs = [rig for rig in (_corrected(name, alone.cameras) for name in TOOL_FAULTS) if rig.tool and rig.tool.found]
    best = min([alone, *rigs], key=_size)
    if best is alone:
        return alone
    others = [rig.tool.fault for rig in rigs if rig.tool and rig is not best and _size(rig) == _size(best)]
    return replace(best, tool=best.tool and replace(best.tool, alternatives=tuple(others)))


def _size(rig: Rig) -> int:
    """Count the faults of cameras and tool."""
    return int(rig.tool is not None) + sum(len(finding.found) for finding in rig.cameras)


def _corrected(name: str, findings: Sequence[SensorFinding]) -> Rig:
    """Estimate a fault of the tool from all cameras, and judge them with it put right.

    A camera may be off by the tolerance, and one with a fault of its own loses weight (iteratively reweighted).
    """
    basis = np.eye(TOTAL)[:, SLICES[name]]
    seen = []
    for finding in findings:
        values, covariance = sum_of(finding).about(basis)
        squared = np.mean([basis.T @ each.displacement.squared @ basis for each in finding.episodes], axis=0)
        seen.append((values, np.linalg.inv(covariance + finding.tolerance_m**2 * np.linalg.inv(squared))))
    weights = np.ones(len(seen))
    for _ in range(ROUNDS):
        total = sum(w * precision for w, (_, precision) in zip(weights, seen, strict=True))
        mean = np.linalg.solve(total, sum(w * p @ v for w, (v, p) in zip(weights, seen, strict=True)))
        weights = np.array([1 / max(1.0, np.sqrt((v - mean) @ p @ (v - mean))) for v, p in seen])
    deviation = basis @ mean
    cameras = [
        judge(
            finding.camera,
            [replace(e, fit=replace(e.fit, evidence=e.fit.evidence.given(deviation))) for e in finding.episodes],
        )
        for finding in findings
    ]
    return Rig(_estimate(name, mean, np.linalg.inv(total), findings), tuple(cameras))


def sum_of(finding: SensorFinding) -> Evidence:
    """Add up the evidence of a camera's episodes."""
    first, *others = (each.fit.evidence for each in finding.episodes)
    return sum(others, first)


def _estimate(name: str, mean: np.ndarray, covariance: np.ndarray, findings: Sequence[SensorFinding]) -> FaultEstimate:
    keys = [p.name for p in TOOL_FAULTS[name].parameters]
    motion = np.mean([each.displacement.squared for finding in findings for each in finding.episodes], axis=0)
    deviation = np.eye(TOTAL)[:, SLICES[name]] @ mean
    effect = float(np.sqrt(deviation @ motion @ deviation))
    matters = effect > np.median([finding.tolerance_m for finding in findings])
    able = _amplitudes(deviation, findings) if matters else np.zeros(0)
    return FaultEstimate(
        name,
        dict(zip(keys, mean.tolist(), strict=True)),
        dict(zip(keys, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        float(np.sqrt(mean @ np.linalg.solve(covariance, mean))),
        effect,
        int((able > HALF).sum()),
        agreed(able, max(len(finding.episodes) for finding in findings)),
    )


def _amplitudes(deviation: np.ndarray, findings: Sequence[SensorFinding]) -> np.ndarray:
    """Give the amplitude of a deviation [19] in each episode that could show it: of the median camera that could."""
    out = []
    for episode in range(max(len(finding.episodes) for finding in findings)):
        each = [f.episodes[episode].fit.evidence for f in findings if episode < len(f.episodes)]
        seen = [(values[0], variance[0, 0]) for values, variance in (e.about(deviation[:, None]) for e in each)]
        able = [amplitude for amplitude, variance in seen if variance < HALF**2]
        out += [float(np.median(able))] if able else []
    return np.array(out)
