"""Sensor faults of a set of recordings, pooled over episodes."""

from __future__ import annotations

from typing import Any

from joblib import Parallel, delayed

from plop.parameters import parameter_text
from plop.pipeline.stage import Output
from plop.recordings.set import RecordingSet
from plop.sensors.estimation.estimate import estimate_sensors, pool
from plop.sensors.estimation.finding import FaultEstimate, SensorFinding
from plop.sensors.faults.library import FAULTS


def sensor_findings(
    recordings: RecordingSet, names: list[str], without: tuple[str, ...], out: Output, *, jobs: int
) -> list[dict[str, Any]]:
    """Estimate every camera's faults and keep the significant ones.

    Args:
        recordings: The set.
        names: Episodes to look at.
        without: Cameras that are left out anyway.
        out: Receives progress.
        jobs: Processes; -1 is one a core.

    Returns:
        One entry a fault: {"camera", "fault", "text", "z", "values": {parameter: {"value", "low", "high", "unit"}},
        "alternatives": faults that would explain it as well}.
    """
    per_episode: list[list[SensorFinding]] = []
    for found in Parallel(n_jobs=jobs, return_as="generator")(
        delayed(estimate_sensors)(recordings.path(name)) for name in names
    ):
        per_episode.append(found)
        out.progress(len(per_episode), len(names), f"sensors of {names[len(per_episode) - 1]}")
    return [
        _entry(finding.camera, fault)
        for finding in pool(per_episode)
        for fault in finding.found
        if finding.camera not in without
    ]


def _entry(camera: str, fault: FaultEstimate) -> dict[str, Any]:
    units = {parameter.name: parameter.unit for parameter in FAULTS[fault.fault].parameters}
    values: dict[str, dict[str, Any]] = {
        key: {
            "value": value,
            "low": value - 1.96 * fault.standard_errors[key],
            "high": value + 1.96 * fault.standard_errors[key],
            "unit": units[key],
        }
        for key, value in fault.values.items()
    }
    shown = ", ".join(parameter_text(key, v) for key, v in values.items() if abs(v["value"]) > 0)
    other = f", or {', '.join(fault.alternatives)}" if fault.alternatives else ""
    return {
        "camera": camera,
        "fault": fault.fault,
        "text": f"{fault.fault}{other} of {camera}: {shown}",
        "z": fault.z,
        "values": values,
        "alternatives": list(fault.alternatives),
    }
