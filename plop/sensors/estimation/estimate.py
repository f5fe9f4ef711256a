"""Sensor faults of every camera of a recording, from table and tool alone: the object may do what it wants."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from plop.errors import PlopError
from plop.recordings.recording import Recording
from plop.sensors.estimation.camera_frames import camera_scene, tool_track
from plop.sensors.estimation.displacement import displacement
from plop.sensors.estimation.finding import Episode, SensorFinding, judge
from plop.sensors.estimation.fit import fit_camera
from plop.sensors.estimation.rig import Rig, judge_rig


def estimate_sensors(recording: str | Path | Recording) -> list[SensorFinding]:
    """Estimate clock offset, pose error, pose drift, depth scale and depth bias of every camera.

    Args:
        recording: Open recording, or the path of one. Its truth is not looked at.

    Returns:
        One finding per camera, in the order of their names.

    Raises:
        PlopError: The recording cannot be read.
    """
    if not isinstance(recording, Recording):
        with Recording.open(recording) as opened:
            return estimate_sensors(opened)
    tool = tool_track(recording)
    out = []
    for name in recording.camera_names:
        scene = camera_scene(recording, name, tool)
        out.append(judge(name, [Episode(fit_camera(scene), displacement(scene))]))
    return out


def pool(findings_per_episode: Sequence[Sequence[SensorFinding]]) -> Rig:
    """Judge the episodes of one rig together: their evidence adds up, and a fault must show in most of them.

    A fault counts as the same in all episodes; a drift starts again with each.

    Args:
        findings_per_episode: What `estimate_sensors` gave for each; cameras may be missing from some.

    Raises:
        PlopError: There is no finding at all.
    """
    by_camera: dict[str, list[Episode]] = {}
    for findings in findings_per_episode:
        for finding in findings:
            by_camera.setdefault(finding.camera, []).extend(finding.episodes)
    if not by_camera:
        raise PlopError(
            "There are no sensor findings to pool.",
            expected="at least one episode with a camera",
            found=f"{len(findings_per_episode)} episodes without cameras",
            fix="Record with one camera at least.",
        )
    return judge_rig(by_camera)
