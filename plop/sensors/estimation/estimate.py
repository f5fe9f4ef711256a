"""Sensor faults of every camera of a recording, from table and tool alone: the object may do what it wants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import transform_points
from plop.recordings.recording import Recording
from plop.sensors.estimation.camera_frames import CameraScene, camera_scene, tool_track
from plop.sensors.estimation.finding import SensorFinding, Viewed, judge
from plop.sensors.estimation.fit import CameraFit, fit_camera
from plop.sensors.estimation.parameters import COUNT


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
        out.append(judge(name, fit_camera(scene), _viewed(scene)))
    return out


def pool(findings_per_episode: Sequence[Sequence[SensorFinding]]) -> list[SensorFinding]:
    """Combine the episodes of one rig: weighted by what each tells, widened by how much they disagree.

    A fault counts as the same in all episodes; a drift starts again with each.

    Args:
        findings_per_episode: What `estimate_sensors` gave for each; cameras may be missing from some.

    Returns:
        One finding per camera, in the order of their names.

    Raises:
        PlopError: There is no finding at all.
    """
    by_camera: dict[str, list[SensorFinding]] = {}
    for findings in findings_per_episode:
        for finding in findings:
            by_camera.setdefault(finding.camera, []).append(finding)
    if not by_camera:
        raise PlopError(
            "There are no sensor findings to pool.",
            expected="at least one episode with a camera",
            found=f"{len(findings_per_episode)} episodes without cameras",
            fix="Record with one camera at least.",
        )
    return [_pooled(camera, findings) for camera, findings in sorted(by_camera.items())]


def _pooled(camera: str, findings: list[SensorFinding]) -> SensorFinding:
    if len(findings) == 1:
        return findings[0]
    information = [np.linalg.inv(each.fit.covariance) for each in findings]
    total = np.sum(information, axis=0)
    values = [each.fit.deviation for each in findings]
    mean = np.linalg.solve(total, np.sum([i @ v for i, v in zip(information, values, strict=True)], axis=0))
    scatter = sum(float((v - mean) @ i @ (v - mean)) for i, v in zip(information, values, strict=True))
    widening = max(1.0, scatter / (COUNT * (len(findings) - 1)))
    fits = [each.fit for each in findings]
    counts = {kind: sum(fit.counts[kind] for fit in fits) for kind in fits[0].counts}
    noise_m = float(np.median([fit.noise_m for fit in fits]))
    fit = CameraFit(max(f.frames for f in fits), mean, np.linalg.inv(total) * widening, noise_m, counts)
    first = findings[0].viewed
    speed = float(np.median([each.viewed.tool_speed_m_s for each in findings]))
    return judge(camera, fit, replace(first, tool_speed_m_s=speed))


def _viewed(scene: CameraScene) -> Viewed:
    middle = transform_points(scene.sightings[0].view.camera.cam_from_world, scene.middle)
    return Viewed(middle, scene.reach_m, scene.tool.speed_m_s if scene.tool else 0.0)
