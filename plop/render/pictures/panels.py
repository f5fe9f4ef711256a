"""Arrange pictures side by side with titles, a colour bar and a line of text, legible at the size of a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from plop.artifacts.atomic_file import whole

PANEL_PX = 512
"""Longer side of the picture of one camera [px]."""
PAPER, PANEL, INK, FAINT, TOOL = (255, 255, 255), (228, 231, 235), (25, 28, 33), (95, 102, 112), (176, 181, 188)
"""Colours around pictures, behind an object, of text, of secondary text, and of a tool in a drawn map."""
_TITLE_PX, _FAINT_PX, _GAP_PX, _BAR_PX, _BAR_ROOM_PX = 26, 20, 10, 20, 90
_HEAD_PX, _FOOT_PX = 72, 46
_LEAST_COLUMN_PX = 384
"""Smallest width of a column, which has room for a title; narrower pictures are centred."""
_DISTANCES = "YlOrRd"
"""From pale for zero to dark red: monotonically darker, so that it is readable with any colour vision."""


@dataclass(frozen=True)
class Titles:
    """Title of a panel."""

    main: str
    below: str = ""
    """A smaller line under it."""


@dataclass(frozen=True)
class Layout:
    """Panels of one size, with the constant parts drawn once."""

    titles: tuple[Titles, ...]
    """One for each panel."""
    size: tuple[int, int]
    """(height, width) of a panel [px]."""
    scale_end_mm: float | None
    """End of the colour bar beside the last panel [mm]; None for no bar."""

    def page(self, panels: Sequence[np.ndarray], texts: Sequence[str]) -> np.ndarray:
        """Fill the layout.

        Args:
            panels: A picture for each title, uint8, shape [height, width, 3].
            texts: Text under each.

        Returns:
            Picture, uint8, shape [H, W, 3], both sides even (as video codecs require).
        """
        canvas = _frame(self).copy()
        for column, panel in enumerate(panels):
            left = _left(self, column) + (_column_px(self) - self.size[1]) // 2
            canvas[_HEAD_PX : _HEAD_PX + self.size[0], left : left + self.size[1]] = panel
        picture = Image.fromarray(canvas)
        pen = ImageDraw.Draw(picture)
        for column, text in enumerate(texts):
            pen.text((_left(self, column), _HEAD_PX + self.size[0] + 10), text, fill=INK, font=_font(_FAINT_PX))
        return np.asarray(picture)


def distance_colours(distance_mm: np.ndarray, end_mm: float) -> np.ndarray:
    """Return the colours of distances, shape [...] -> uint8 [..., 3]; distances beyond the end have its colour."""
    shares = np.clip(np.nan_to_num(distance_mm) / end_mm, 0, 1)
    return np.asarray(_colour_table()[np.round(255 * shares).astype(np.uint8)])


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture, uint8, shape [H, W, 3]; the same picture gives the same bytes.

    Raises:
        PlopError: The disk is full.
    """
    with whole(path) as scratch:
        Image.fromarray(picture).save(scratch, format="PNG")


def sheet(rows: Sequence[np.ndarray]) -> np.ndarray:
    """Stack equally wide pictures, shape [H, W, 3] each, into one."""
    return np.concatenate(rows, axis=0)


def millimetres(value: float) -> str:
    """Format millimetres with a readable number of digits."""
    return f"{value:.2f} mm" if value < 0.995 else f"{value:.1f} mm" if value < 9.95 else f"{value:.0f} mm"


@lru_cache(maxsize=1)
def _colour_table() -> np.ndarray:
    return matplotlib.colormaps[_DISTANCES](np.arange(256), bytes=True)[:, :3]


@lru_cache(maxsize=8)
def _frame(layout: Layout) -> np.ndarray:
    """Draw paper, titles and colour bar."""
    height = _even(_HEAD_PX + layout.size[0] + _FOOT_PX)
    bar = _BAR_ROOM_PX if layout.scale_end_mm is not None else 0
    picture = Image.new("RGB", (_even(_left(layout, len(layout.titles)) + bar), height), PAPER)
    pen = ImageDraw.Draw(picture)
    for column, title in enumerate(layout.titles):
        left = _left(layout, column)
        pen.text((left, 8), title.main, fill=INK, font=_font(_TITLE_PX, bold=True))
        pen.text((left, 8 + _TITLE_PX + 6), title.below, fill=FAINT, font=_font(_FAINT_PX))
    if layout.scale_end_mm is not None:
        _draw_bar(picture, layout.scale_end_mm, _left(layout, len(layout.titles)), layout.size[0])
    return np.asarray(picture)


def _draw_bar(picture: Image.Image, end_mm: float, left: int, height: int) -> None:
    """Draw a colour bar as high as a panel, with numbers at its ends and quarters, and its unit above."""
    pen = ImageDraw.Draw(picture)
    font = _font(_FAINT_PX)
    shares = 1 - (np.arange(height) + 0.5) / height
    colours = distance_colours(shares * end_mm, end_mm)
    strip = np.repeat(colours[:, None], _BAR_PX, axis=1)
    picture.paste(Image.fromarray(np.ascontiguousarray(strip)), (left, _HEAD_PX))
    pen.rectangle((left, _HEAD_PX, left + _BAR_PX - 1, _HEAD_PX + height - 1), outline=FAINT)
    pen.text((left, _HEAD_PX - _FAINT_PX - 8), "mm", fill=INK, font=font)
    for share in (0, 0.25, 0.5, 0.75, 1):
        middle = _HEAD_PX + round((1 - share) * (height - 1))
        pen.line((left + _BAR_PX, middle, left + _BAR_PX + 4, middle), fill=FAINT, width=2)
        beyond = "≥" if share == 1 else ""
        lowest, highest = _HEAD_PX, _HEAD_PX + height - _FAINT_PX - 4
        at = min(max(middle - _FAINT_PX // 2 - 3, lowest), highest)
        pen.text((left + _BAR_PX + 8, at), f"{beyond}{share * end_mm:.3g}", fill=INK, font=font)


def _column_px(layout: Layout) -> int:
    return max(layout.size[1], _LEAST_COLUMN_PX)


def _left(layout: Layout, column: int) -> int:
    return _GAP_PX + column * (_column_px(layout) + _GAP_PX)


def _even(size: int) -> int:
    return size + size % 2


@lru_cache(maxsize=8)
def _font(size_px: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Load the font that is shipped with matplotlib: a machine may have none."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)
