"""Score one episode: the prediction and both baselines against every measured frame."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plop.artifacts.layouts import Fit, Rollout
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.geometry.view import View
from plop.metrics.clouds import back_project_all
from plop.metrics.frame import FrameOptions, Scores, score_frame
from plop.metrics.lpips import Lpips, Unavailable
from plop.pipeline.mapping import Progress
from plop.recordings.busiest_camera import busiest_camera, check_camera
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.render.pictures.comparison import Comparison
from plop.render.pictures.panels import sheet, write_png
from plop.render.rigid_motion import moved_rigidly
from plop.render.scene import render_scene, tool_above_table
from plop.render.view_file import ViewFile
from stages.eval.baselines import RigidFit
from stages.eval.material import MaterialPoints
from stages.eval.rivals import Rivals

if TYPE_CHECKING:
    from stages.eval.stage import EvalConfig


@dataclass(frozen=True)
class EpisodePaths:
    """Paths of one episode's inputs."""

    init: Fit
    """Gaussians at frame 0."""
    rollout: Rollout
    """The prediction."""
    picture: Path
    """Picture to write."""


@dataclass(frozen=True)
class Frame:
    """One frame, prepared for scoring."""

    index: int
    measured: list[View]
    predictions: dict[str, list[View]]
    """Views by method."""
    rigid_pose: np.ndarray
    """Motion of the rigid baseline since frame 0, shape [4, 4]."""
    rivals: dict[str, Gaussians]
    """The rivals' Gaussians."""


def score_episode(
    recordings: RecordingSet,
    name: str,
    paths: EpisodePaths,
    config: EvalConfig,
    lpips: Lpips | Unavailable,
    rivals: Rivals,
    progress: Progress,
) -> list[dict]:
    """Score one episode and draw its picture.

    Args:
        recordings: The set with the episode.
        name: The episode.
        paths: Its inputs.
        config: Settings.
        lpips: The loaded score, or why there is none.
        rivals: Further predictions to score.
        progress: Called after every frame.

    Returns:
        One row per method and frame: episode, method, frame, time_s and the scores.
    """
    jobs: list[tuple[dict, Future[Scores]]] = []
    with ExitStack() as stack:
        recording = stack.enter_context(recordings.open(name))
        views = stack.enter_context(ViewFile(paths.rollout.images))
        pool = stack.enter_context(ThreadPoolExecutor(config.threads or cpu_count()))
        material = stack.enter_context(MaterialPoints(recording.path, paths.rollout.states, use=config.truth))
        _check_match(views, recording)
        check_camera(recording, config.picture_camera)
        frames, times = len(recording), recording.time_s
        for frame in _frames(recording, views, paths.init, rivals, config):
            with_emd = config.emd_every > 0 and (frame.index % config.emd_every == 0 or frame.index == frames - 1)
            options = FrameOptions(config.seed, with_emd, lpips.score if isinstance(lpips, Lpips) else None)
            for method, predicted in frame.predictions.items():
                row = {"episode": name, "method": method, "frame": frame.index, "time_s": float(times[frame.index])}
                jobs.append((row, pool.submit(score_frame, predicted, frame.measured, options)))
            material.add(frame.index, config.method, frame.rigid_pose, frame.rivals)
            progress(frame.index + 1, frames, name)
        counts = _resampled(paths.rollout.states)
        rows = [row | job.result() | material.score(row["frame"], row["method"]) for row, job in jobs]
        rows = [row | (counts.get(row["frame"], {}) if row["method"] == config.method else {}) for row in rows]
        _draw(recording, views, paths, config)
    return rows


def _resampled(states: Path) -> dict[int, dict[str, int]]:
    """Read the merges and splits of each frame of a rollout; empty without its states, or in those of before 0.2."""
    try:
        with Trajectory(states) as file:
            frames = file.frames("states")
            return {f: {key: int(file.extra("states", f, key)) for key in ("merges", "splits")} for f in frames}
    except PlopError:
        return {}


def _draw(recording: Recording, views: ViewFile, paths: EpisodePaths, config: EvalConfig) -> None:
    """Write the picture of the first, the middle and the last frame."""
    camera = busiest_camera(recording, config.picture_camera)
    _, tool = _read_init(paths.init)
    frames = sorted({0, len(recording) // 2, len(recording) - 1})
    path = paths.rollout.states
    with Trajectory(path) if path.is_file() else nullcontext() as states:
        drawn = Comparison(recording, views, states, tool, camera, frames=frames, backend=config.backend)
        write_png(paths.picture, sheet([drawn.picture(frame) for frame in frames]))


def _frames(recording: Recording, views: ViewFile, init: Fit, rivals: Rivals, config: EvalConfig) -> Iterator[Frame]:
    """Read measurement and prediction, and render the baselines."""
    start, tool = _read_init(init)
    names, poses = recording.camera_names, recording.world_from_tool
    pose, fit = np.eye(4), None
    others = rivals.roll_out(recording, start)
    for index in range(len(recording)):
        measured = [recording.view(name, index) for name in names]
        cameras = [view.camera for view in measured]
        cloud = back_project_all(measured, seed=config.seed)
        if fit is None and len(cloud):
            fit = RigidFit(cloud.points, config.seed)
        elif fit is not None and len(cloud):
            pose = fit.best(cloud.points, [pose, np.eye(4)])
        placed = tool_above_table(tool, poses[index], recording.table_z_m)
        mine = {name: frames[index] for name, frames in others.items()}
        objects = {"persistence": moved_rigidly(start, np.eye(4)), "rigid": moved_rigidly(start, pose), **mine}
        drawn = {
            method: render_scene(gaussians, placed, cameras, backend=config.backend)
            for method, gaussians in objects.items()
        }
        predicted = {config.method: [views.view(camera, index) for camera in cameras]}
        yield Frame(index, measured, predicted | drawn, pose, mine)


def _read_init(init: Fit) -> tuple[Gaussians, Gaussians]:
    init.present(fix="Use the `plop fit-init` artifact that the rollout started from.")
    return read_splat(init.object_splat), read_splat(init.tool_splat)


def _check_match(views: ViewFile, recording: Recording) -> None:
    pairs = {
        "episode": (recording.name, views.name),
        "environment": (recording.environment, views.environment),
        "cameras": (", ".join(recording.camera_names), ", ".join(views.camera_names)),
        "frames": (str(len(recording)), str(len(views))),
    }
    for what, (expected, found) in pairs.items():
        if expected != found:
            raise PlopError(
                f"The rollout and the recording differ in {what}.",
                where=views.path,
                expected=expected,
                found=found,
                fix="Use the recordings that the rollout was made from.",
            )
