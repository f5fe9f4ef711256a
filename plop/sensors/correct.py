"""Undo sensor faults view by view; recordings stay as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plop.recordings.recording import Recording
from plop.sensors.estimation.camera_frames import Sighting
from plop.sensors.estimation.finding import FaultEstimate, SensorFinding
from plop.sensors.faults.fault import Fault
from plop.sensors.faults.library import FAULTS, Faults, frame_share


def found_faults(findings: Sequence[SensorFinding]) -> Faults:
    """Give the faults that were found, as laws that can be undone."""
    return Faults({finding.camera: [_fault(each) for each in finding.found] for finding in findings})


def correct_view(recording: Recording, camera: str, frame: int, faults: Faults) -> Sighting:
    """Read one view and undo its camera's faults.

    Args:
        recording: Open recording.
        camera: Name of the camera.
        frame: Index of the frame.
        faults: E.g. from `found_faults`; a camera without faults gives its view unchanged.

    Returns:
        True pose, true depth, and the time at which the scene looked like this; colours and labels as recorded.

    Raises:
        PlopError: There is no such camera.
    """
    view, share = recording.view(camera, frame), frame_share(frame, len(recording))
    pose = faults.true_pose(camera, share, view.camera.world_from_cam)
    true = replace(view.camera, world_from_cam=pose)
    depth = faults.true_depth(camera, view.depth_m)
    time_s = faults.true_time(camera, float(recording.time_s[frame]))
    return Sighting(time_s, share, replace(view, camera=true, depth_m=depth))


def _fault(estimate: FaultEstimate) -> Fault:
    kind = FAULTS[estimate.fault]
    return kind(**{p.name: float(np.clip(estimate.values[p.name], p.low, p.high)) for p in kind.parameters})
