"""One picture an environment: a test episode as it was measured, and as the models predict it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.peers.pipeline import Pipeline
from plop.artifacts.layouts import Rollout
from plop.geometry.view import View
from plop.recordings.set import RecordingSet
from plop.render.pictures.enlarge import Crop, resized
from plop.render.pictures.panels import PANEL, Layout, Titles, sheet
from plop.render.view_file import ViewFile

SHOWN = {"i2n": "PLOP", "gs-dynamics": "gs-dynamics", "engine": "engine"}
"""Model -> its title; the engine where it was fitted."""
_PANEL_PX, _QUALITY = 384, 85


def strip(pipeline: Pipeline, path: Path) -> None:
    """Draw the first, the middle and the last frame of the last test episode, a row each; JPEG.

    Args:
        pipeline: A workspace that has been carried out; its first seed is shown.
        path: The picture.
    """
    known = RecordingSet.load(pipeline.store.find("recordings").path)
    episode = known.test[-1]
    seed = pipeline.plan.seeds[0]
    titles = {model: title for model, title in SHOWN.items() if model != "engine" or pipeline.plan.engine}
    with ExitStack() as stack:
        recording = stack.enter_context(known.open(episode))
        files = [pipeline.store.find(f"rollout-{model}-{seed}").path / episode for model in titles]
        predicted = [stack.enter_context(ViewFile(Rollout(file).images)) for file in files]
        camera = recording.camera_names[0]
        frames = [0, len(recording) // 2, len(recording) - 1]
        rows = [
            [measured, *(views.view(measured.camera, frame) for views in predicted)]
            for frame, measured in ((frame, recording.view(camera, frame)) for frame in frames)
        ]
        times = [f"t = {recording.time_s[frame] - recording.time_s[0]:.2f} s" for frame in frames]
    Image.fromarray(_sheet(rows, times, ["measured", *titles.values()])).save(path, quality=_QUALITY)


def _sheet(rows: list[list[View]], times: list[str], titles: list[str]) -> np.ndarray:
    crop = Crop.around([view.object_mask for row in rows for view in row], _PANEL_PX)
    layout = Layout(tuple(Titles(title) for title in titles), crop.size, None)
    shown = [[resized(crop.of(_on_paper(view)).astype(np.float32), crop.size) for view in row] for row in rows]
    panels = [[panel.clip(0, 255).astype(np.uint8) for panel in row] for row in shown]
    return sheet([layout.page(row, [time]) for row, time in zip(panels, times, strict=True)])


def _on_paper(view: View) -> np.ndarray:
    """Show object and tool only: a predicted view has nothing behind them."""
    return np.where((view.object_mask | view.tool_mask)[..., None], view.rgb, np.array(PANEL, np.uint8))
