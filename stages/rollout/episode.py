"""Roll out one episode: states, rendered views and, on request, splat files; then its video and a picture of it.

The prediction uses frame 0 (its Gaussians and its depth), the tool's motion, the times and the table. Measured
images of later frames are used only in the video (and for the choice of its camera).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from plop.artifacts.layouts import Fit, Rollout, Rollouts
from plop.dynamics.episodes import Actions
from plop.dynamics.initial_surface import initial_surface
from plop.dynamics.interface import DynamicsModel, ParticleState, at_rest
from plop.dynamics.rollout import predict
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat, write_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory, TrajectoryWriter
from plop.geometry.view import View
from plop.models import device_of
from plop.pipeline.stage import Output
from plop.recordings.busiest_camera import busiest_camera
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.render.pictures.comparison import Comparison
from plop.render.pictures.panels import write_png
from plop.render.pictures.video import VideoWriter
from plop.render.scene import render_scene, tool_above_table
from plop.render.view_file import ViewFile, ViewWriter
from plop.uncertainty.band import Band
from plop.uncertainty.spread import ensemble_spread

if TYPE_CHECKING:
    from stages.rollout.stage import RolloutConfig


def predicted(
    models: Sequence[DynamicsModel], recording: Recording, start: Gaussians, seed: int
) -> Iterator[tuple[ParticleState, float, np.ndarray | None]]:
    """Yield the first model's state of every frame, its time for it [ms], and the spread of all models, [N] [m].

    Args:
        models: One, whose spread is None, or several.
        recording: The episode; its first frame and the tool's motion are read.
        start: Gaussians at frame 0.
        seed: Of the models' random numbers.
    """
    moves = Actions.of(recording, start.means.device).steps()
    initial = at_rest(start, initial_surface(recording, start))
    for (state, ms), *others in zip(
        *(predict(model, initial, moves, recording.name, seed) for model in models), strict=True
    ):
        members = [other.gaussians for other, _ in others]
        yield state, ms, ensemble_spread(start, state.gaussians, members) if members else None


def roll_out(
    models: Sequence[DynamicsModel],
    band: Band | None,
    recordings: RecordingSet,
    name: str,
    init: Fit,
    config: RolloutConfig,
    out: Output,
) -> tuple[dict, list[float]]:
    """Predict, render and write one episode.

    Args:
        models: The first one predicts; the others give the spread.
        band: How wide the band is; None for one model.
        recordings: The set with the episode.
        name: The episode.
        init: Gaussians of this episode.
        config: Settings.
        out: Where `<name>/` is written.

    Returns:
        A row for the summary's table and the model's time per step [ms].
    """
    device = device_of(models[0])
    start, tool = (read_splat(path).to(device) for path in (init.object_splat, init.tool_splat))
    files = Rollouts(out.path).episode(name)
    files.folder.mkdir(parents=True, exist_ok=True)
    steps_ms: list[float] = []
    with recordings.open(name) as recording:
        video_camera = busiest_camera(recording, config.video_camera)
        _check_same_object(start, recording, config.min_inside)
        frames, poses = len(recording), recording.world_from_tool
        with (
            TrajectoryWriter(files.states) as states,
            ViewWriter(files.images, name=name, environment=recording.environment, frames=frames) as images,
        ):
            merges, splits = 0, 0
            for frame, (state, ms, spread) in enumerate(predicted(models, recording, start, config.seed)):
                done = resampled(state)
                merges, splits = merges + int(done["merges"]), splits + int(done["splits"])
                if band is not None and spread is not None:
                    done |= {"spread_m": spread.astype("f4"), "radius_m": band.radius_m(spread).astype("f4")}
                states.append("states", frame, state.gaussians, side=state.side, **done)
                cameras = [recording.camera(camera, frame) for camera in recording.camera_names]
                placed = tool_above_table(tool, poses[frame], recording.table_z_m)
                views = render_scene(state.gaussians, placed, cameras, backend=config.backend)
                images.write_frame(frame, views)
                if config.animation:
                    files.frame(frame).parent.mkdir(exist_ok=True)
                    write_splat(files.frame(frame), state.gaussians)
                steps_ms += [ms] if frame else []
                out.progress(frame + 1, frames, name, gaussians=len(state.gaussians))
        _film(recording, tool, video_camera, files, config, out)
    row = {
        "episode": name,
        "frames": frames,
        "gaussians_first": len(start),
        "gaussians_last": len(state.gaussians),
        "merges": merges,
        "splits": splits,
        "step_ms": round(float(np.median(steps_ms)), 2),
    }
    return row, steps_ms


def resampled(state: ParticleState) -> dict[str, np.ndarray]:
    """Return the numbers of merges and splits of a state's last step."""
    merges, splits = (0, 0) if state.resampling is None else (state.resampling.merges, state.resampling.splits)
    return {"merges": np.asarray(merges), "splits": np.asarray(splits)}


def _film(
    recording: Recording, tool: Gaussians, camera: str, files: Rollout, config: RolloutConfig, out: Output
) -> None:
    """Write the video and a picture of its frame with the largest difference, from the files of the rollout."""
    frames = len(recording)
    rate = config.video_rate_hz or (frames - 1) / float(np.ptp(recording.time_s))
    with (
        ViewFile(files.images) as images,
        Trajectory(files.states) as states,
        VideoWriter(files.video, rate_hz=rate) as video,
    ):
        device = tool.means.device
        drawn = Comparison(recording, images, states, tool, camera, backend=config.backend, device=device)
        still = drawn.telling_frame()
        for frame in range(frames):
            picture = drawn.picture(frame)
            video.append(picture)
            if frame == still:
                write_png(files.still, picture)
            out.progress(frame + 1, frames, f"{recording.name} video")


def _check_same_object(start: Gaussians, recording: Recording, least: float) -> None:
    """Reject a fit whose Gaussians are not where frame 0 shows the object (or the tool in front of it)."""
    if len(recording) < 2:
        raise PlopError(
            "There is nothing to predict.",
            where=recording.path,
            expected="at least 2 frames",
            found=f"{len(recording)} frame(s)",
            fix="Leave this episode out.",
        )
    inside = []
    for name in recording.camera_names:
        view = recording.view(name, 0)
        if view.object_mask.any():
            inside.append(_part_inside(start.means.cpu().numpy(), view))
    if not inside:
        raise PlopError(
            "No camera sees the object at frame 0.",
            where=recording.path,
            expected="an object mask",
            found="empty masks in all cameras",
            fix="Check the masks of `plop ingest`.",
        )
    if np.mean(inside) < least:
        raise PlopError(
            "The fitted Gaussians are of another object.",
            where=f"{recording.name}, frame 0",
            expected=f"at least {least:.0%} of them inside the object's masks",
            found=f"{np.mean(inside):.0%}",
            fix="Run `plop fit-init` on these recordings.",
        )


def _part_inside(points: np.ndarray, view: View) -> float:
    visible, rows, columns, _ = view.camera.pixels_of(points)
    covered = view.object_mask | view.tool_mask
    return float(covered[rows, columns][visible].mean()) if visible.any() else 0.0
