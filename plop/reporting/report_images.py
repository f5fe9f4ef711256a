"""Measured, predicted and their difference as small pictures inside a page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from PIL import Image

from plop.comparison.camera_errors import CarriedScene
from plop.geometry.view import View
from plop.recordings.busiest_camera import busiest_camera
from plop.recordings.recording import Recording

DIFFERENCE_MAP = "PuOr"
"""Diverging colours that all colour vision tells apart."""
_EMPTY, _TOOL, _ONLY_MEASURED, _ONLY_PREDICTED = (236, 238, 241), (190, 194, 199), (20, 20, 20), (120, 120, 120)
_NAMED = 4
"""Palette entries before those of the difference."""


@lru_cache
def difference_palette(steps: int = 63) -> tuple[tuple[int, int, int], ...]:
    """Give the colours of a depth difference, predicted nearer first."""
    colours = colormaps[DIFFERENCE_MAP](np.arange(steps) / (steps - 1))[:, :3]
    return tuple((round(255 * r), round(255 * g), round(255 * b)) for r, g, b in colours.tolist())


def episode_images(
    recording_path: Path,
    init: Path,
    points: np.ndarray,
    patch: np.ndarray,
    predictions: Sequence[np.ndarray],
    frames: Sequence[int],
    *,
    camera: str = "",
    limit_mm: float,
) -> dict[str, Any]:
    """Render the pictures of one episode.

    Args:
        recording_path: The recording.
        init: Folder of the episode's fit.
        points: Followed points at the first frame, [M, 3] [m].
        patch: Patch of every point, [M].
        predictions: Each model's points, [T, M, 3] [m].
        frames: Frames to show.
        camera: The camera; the one whose image changes most without.
        limit_mm: Depth difference at the ends of the colour scale [mm].

    Returns:
        {"camera", "measured": [uri], "models": [{"predicted": [uri], "difference": [uri]}]}.
    """
    scene = CarriedScene(init, points, patch)
    models: list[dict[str, list[str]]] = [{"predicted": [], "difference": []} for _ in predictions]
    measured = []
    with Recording.open(recording_path) as recording:
        name = busiest_camera(recording, camera)
        for frame in frames:
            seen = recording.view(name, frame)
            measured.append(_photo(over_grey(seen)))
            for model, predicted in zip(models, predictions, strict=True):
                [view] = scene.views(recording, frame, predicted[frame], [name])
                model["predicted"].append(_photo(over_grey(view)))
                model["difference"].append(_palette_png(difference(seen, view, limit_mm)))
    return {"camera": name, "measured": measured, "models": models}


def over_grey(view: View) -> np.ndarray:
    """Keep object and tool, light grey elsewhere; uint8, shape [H, W, 3]."""
    return np.where((view.object_mask | view.tool_mask)[..., None], view.rgb, np.array(_EMPTY, np.uint8))


def difference(measured: View, predicted: View, limit_mm: float) -> np.ndarray:
    """Give palette entries of predicted minus measured depth, uint8 [H, W].

    Where only one of the two shows the object the pixel says so instead.
    """
    ours, theirs = predicted.object_mask, measured.object_mask
    steps = len(difference_palette())
    share = 0.5 + 0.5 * 1000 * (predicted.depth_m - measured.depth_m) / limit_mm
    entry = _NAMED + np.clip(np.nan_to_num(share) * (steps - 1), 0, steps - 1).round().astype(np.uint8)
    known = (measured.depth_m > 0) & (predicted.depth_m > 0)
    picture = np.zeros(ours.shape, np.uint8)
    tool = measured.tool_mask | predicted.tool_mask
    picture[tool] = 1
    picture[theirs & ~ours & ~tool], picture[ours & ~theirs & ~tool] = 2, 3
    return np.where(ours & theirs & known, entry, picture)


def _photo(rgb: np.ndarray) -> str:
    stream = io.BytesIO()
    Image.fromarray(rgb).save(stream, "JPEG", quality=86)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode()


def _palette_png(entries: np.ndarray) -> str:
    image = Image.fromarray(entries, "P")
    colours = [_EMPTY, _TOOL, _ONLY_MEASURED, _ONLY_PREDICTED, *difference_palette()]
    image.putpalette([part for colour in colours for part in colour])
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return png_address(stream.getvalue())


def png_address(content: bytes) -> str:
    """Return the address that holds a PNG inside a page."""
    return "data:image/png;base64," + base64.b64encode(content).decode()
