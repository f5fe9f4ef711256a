"""Predicted states against what the cameras measured, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from plop.dynamics.initial_scene import InitialScene
from plop.dynamics.interface import ParticleState
from plop.errors import PlopError
from plop.metrics.frame import CONVENTIONS, FrameOptions, score_frame
from plop.recordings.recording import Recording
from plop.render.rasterizer.rasterize import Backend
from plop.render.scene import render_scene, tool_above_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEFT_OUT = ("emd_mm", "lpips", "truth_rms_mm")
"""Scores of `plop eval` that take long, need a file of weights, or the simulator's truth."""


@dataclass(frozen=True)
class FrameErrors:
    """The scores of every frame of one rollout."""

    name: str
    """The episode."""
    time_s: np.ndarray
    """Shape [T] [s]."""
    scores: dict[str, np.ndarray]
    """By name, shape [T]; NaN where a score is undefined. `plop.metrics.frame.CONVENTIONS` says what each means."""

    def __getitem__(self, score: str) -> np.ndarray:
        return self.scores[score]

    def plot(self, score: str = "cd_mm", axes: Axes | None = None, **style: Any) -> Axes:
        """Draw one score over time.

        Args:
            score: Its name.
            axes: Where to draw; None makes a new figure.
            style: Options of matplotlib's `plot`.

        Returns:
            The axes, for more lines or to save the figure.
        """
        if axes is None:
            from matplotlib import pyplot

            axes = pyplot.subplots()[1]
        axes.plot(self.time_s, self.scores[score], **{"label": self.name, **style})
        axes.set_xlabel("time [s]")
        axes.set_ylabel(score)
        axes.set_title(CONVENTIONS[score].partition(";")[0], fontsize="small")
        axes.legend()
        return axes


def compare(
    states: Sequence[ParticleState], scene: InitialScene, recording: Recording, *, backend: Backend = "auto"
) -> FrameErrors:
    """Score a rollout against the measured views, as `plop eval` does, without its slowest scores.

    Args:
        states: Every frame of the rollout, the first included.
        scene: Where it started; its tool is rendered with the object and hides what it hid from the cameras.
        recording: The episode.
        backend: See `plop.render.rasterizer.rasterize.render`.

    Raises:
        PlopError: There are not as many states as frames.
    """
    if len(states) != len(recording):
        raise PlopError(
            "The rollout and the recording differ in length.",
            where=recording.path,
            expected=f"{len(recording)} states, one a frame",
            found=str(len(states)),
            fix="Roll out the actions of this recording.",
        )
    poses = recording.world_from_tool
    rows: list[dict[str, float | None]] = []
    for frame, state in enumerate(states):
        measured = [recording.view(camera, frame) for camera in recording.camera_names]
        tool = scene.tool_gaussians
        placed = None if tool is None else tool_above_table(tool, poses[frame], scene.table_z_m)
        predicted = render_scene(state.gaussians, placed, [view.camera for view in measured], backend=backend)
        rows.append(score_frame(predicted, measured, FrameOptions(emd=False)))
    names = [name for name in CONVENTIONS if name not in LEFT_OUT]
    scores = {name: np.array([row[name] for row in rows], float) for name in names}
    return FrameErrors(recording.name, np.asarray(recording.time_s), scores)
