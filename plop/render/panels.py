"""Pictures that put a prediction beside its measurement: measured | predicted | difference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from plop.recordings.recording import View

TITLES = ("measured", "predicted", "difference")
_GAP_PX, _TITLE_PX = 4, 16


def side_by_side(measured: np.ndarray, predicted: np.ndarray, *, label: str = "", least_px: int = 256) -> np.ndarray:
    """Lay out measured | predicted | difference with titles.

    Args:
        measured: Shape [H, W, 3], uint8.
        predicted: Same shape.
        label: Text in the first title, e.g. the time.
        least_px: Images are enlarged by a whole factor until their height reaches this [px].

    Returns:
        Picture, uint8, shape [H', W', 3], both sides even (as video codecs want).
    """
    difference = np.abs(measured.astype(np.int16) - predicted).astype(np.uint8)
    scale = max(1, -(-least_px // measured.shape[0]))
    images = [image.repeat(scale, 0).repeat(scale, 1) for image in (measured, predicted, difference)]
    height, width = images[0].shape[:2]
    canvas = np.full((height + _TITLE_PX, 3 * width + 2 * _GAP_PX, 3), 255, np.uint8)
    for column, image in enumerate(images):
        start = column * (width + _GAP_PX)
        canvas[_TITLE_PX:, start : start + width] = image
    picture = Image.fromarray(canvas)
    pen = ImageDraw.Draw(picture)
    for column, title in enumerate(TITLES):
        text = f"{title}  {label}" if column == 0 and label else title
        pen.text((column * (width + _GAP_PX) + 4, 2), text, fill=(0, 0, 0))
    return _even(np.asarray(picture))


def over_black(view: View) -> np.ndarray:
    """Keep object and tool, black elsewhere, as scores see a view; uint8, shape [H, W, 3]."""
    return np.where((view.object_mask | view.tool_mask)[..., None], view.rgb, np.uint8(0))


def sheet(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Stack equally wide pictures, shape [H, W, 3] each, into one."""
    return np.concatenate(rows, axis=0)


def _even(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), constant_values=255)
