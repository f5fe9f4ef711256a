"""Whether the images of a camera are turned or mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from plop.geometry.view import View
from plop.sensors.checks.support_plane import Support, find_support, turned
from plop.sensors.checks.tool_fit import THROUGH, ToolFit, ToolLook

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig


def orientation_fault(
    views: list[View],
    tool_poses: Sequence[np.ndarray],
    look: ToolLook,
    support: Support,
    table_mm: float | None,
    tool: ToolFit,
    config: CalibrateConfig,
) -> str:
    """Say which turn of the pictures puts table and tool where they should be, "" when they are or none does."""
    off = table_mm is not None and support.is_far(support.height_m - table_mm / 1e3)
    gone = tool.through is not None and tool.through > THROUGH
    if not off and not gone:
        return ""
    ways = [(2, False), (0, True), (2, True)]
    if views[0].camera.width == views[0].camera.height:
        ways += [(1, False), (3, False), (1, True), (3, True)]
    fits = []
    for turns, mirrored in ways:
        trial = [turned(view, turns, mirrored) for view in views]
        plane = find_support(trial[0])
        if plane is None or (
            table_mm is not None
            and (
                plane.tilt_deg > config.max_table_deg
                or abs(1e3 * (plane.height_m - support.height_m) + table_mm) > config.max_table_mm
            )
        ):
            continue
        fit = look.fit(trial, tool_poses)
        if fit.through is None or fit.through < (THROUGH if off else THROUGH / 3):
            fits.append((fit.measured_px - fit.through_px, turns, mirrored))
    if not fits:
        return ""
    most = max(score for score, *_ in fits)
    what = " or ".join(_turn_name(turns, mirrored) for score, turns, mirrored in fits if score > 0.9 * most)
    seen = (
        f"the table is seen {table_mm:+.0f} mm and {support.tilt_deg:.0f} deg off"
        if off
        else (f"{100 * (tool.through or 0):.0f} % of the tool is looked through")
    )
    return f"its pictures are not the way its pose says: {what} before ingest ({seen}; so turned it is right)"


def _turn_name(turns: int, mirrored: bool) -> str:
    if turns == 2:
        return "mirror them top to bottom (upside down)" if mirrored else "turn them by 180 deg (upside down)"
    side = "mirror them left to right" if mirrored else ""
    turn = f"turn them by {90 if turns == 1 else -90} deg counter-clockwise" if turns else ""
    return " and ".join(filter(None, (side, turn)))
