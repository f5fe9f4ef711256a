"""Undo sensor faults view by view; recordings stay as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.recordings.recording import Recording, View
from plop.sensors.estimation.finding import FaultEstimate, SensorFinding
from plop.sensors.faults.fault import Fault
from plop.sensors.faults.library import FAULTS, Faults, frame_share


@dataclass(frozen=True)
class CorrectedView:
    """One view as it would be without the camera's faults."""

    view: View
    """True pose, true depth; colours and labels as recorded."""
    scene_time_s: float
    """When the scene looked like this, on the robot's clock [s]."""


def found_faults(findings: Sequence[SensorFinding]) -> Faults:
    """Give the faults that were found, as laws that can be undone."""
    return Faults({finding.camera: [_fault(each) for each in finding.found] for finding in findings})


def correct_view(recording: Recording, camera: str, frame: int, faults: Faults) -> CorrectedView:
    """Read one view and undo its camera's faults.

    Args:
        recording: Open recording.
        camera: Name of the camera.
        frame: Index of the frame.
        faults: E.g. from `found_faults`; a camera without faults gives its view unchanged.

    Raises:
        PlopError: There is no such camera.
    """
    view = recording.view(camera, frame)
    pose = faults.true_pose(camera, frame_share(frame, len(recording)), view.camera.world_from_cam)
    true = replace(view.camera, world_from_cam=pose)
    depth = faults.true_depth(camera, view.depth_m)
    return CorrectedView(
        replace(view, camera=true, depth_m=depth), faults.true_time(camera, float(recording.time_s[frame]))
    )


def _fault(estimate: FaultEstimate) -> Fault:
    kind = FAULTS[estimate.fault]
    return kind(**{p.name: float(np.clip(estimate.values[p.name], p.low, p.high)) for p in kind.parameters})
