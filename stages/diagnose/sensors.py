"""Sensor faults of a set of recordings, pooled over episodes."""

from __future__ import annotations

from joblib import Parallel, delayed

from plop.compute.workers import workers
from plop.diagnosis.decision.result import SensorFault
from plop.parameters import Estimate, estimate_text
from plop.pipeline.stage import Output
from plop.recordings.set import RecordingSet
from plop.sensors.estimation.estimate import estimate_sensors, pool
from plop.sensors.estimation.finding import FaultEstimate, SensorFinding
from plop.sensors.faults.library import ALL_FAULTS, TOOL


def sensor_findings(
    recordings: RecordingSet, names: list[str], without: tuple[str, ...], out: Output, *, jobs: int
) -> tuple[SensorFault, ...]:
    """Give the faults of cameras and tool that displace the object, in most episodes.

    Args:
        recordings: The set.
        names: Episodes to look at.
        without: Cameras that are left out anyway.
        out: Receives progress.
        jobs: Processes; -1 is one a core.
    """
    per_episode: list[list[SensorFinding]] = []
    with workers():
        estimates = Parallel(n_jobs=jobs, return_as="generator")(
            delayed(estimate_sensors)(recordings.path(name)) for name in names
        )
    for found in estimates:
        per_episode.append(found)
        out.progress(len(per_episode), len(names), f"sensors of {names[len(per_episode) - 1]}")
    rig = pool(per_episode)
    faults = [(TOOL, rig.tool)] if rig.tool else []
    faults += [(each.camera, fault) for each in rig.cameras for fault in each.found if each.camera not in without]
    return tuple(_entry(camera, fault, len(names)) for camera, fault in faults)


def _entry(camera: str, fault: FaultEstimate, episodes: int) -> SensorFault:
    units = {parameter.name: parameter.unit for parameter in ALL_FAULTS[fault.fault].parameters}
    widths = {key: 1.96 * error for key, error in fault.standard_errors.items()}
    values = {
        key: Estimate(value, value - widths[key], value + widths[key], units[key])
        for key, value in fault.values.items()
    }
    shown = ", ".join(estimate_text(key, found) for key, found in values.items() if abs(found.value) > 0)
    other = f", or {', '.join(fault.alternatives)}" if fault.alternatives else ""
    moved = f"off by {1000 * fault.effect_m:.1f} mm at the object in {fault.episodes} of {episodes} episodes"
    text = f"{fault.fault}{other} of {camera}: {shown}; {moved}"
    return SensorFault(camera, fault.fault, text, fault.z, values, fault.alternatives)
