"""A hand-eye pose does not replace a recorded one that the other cameras confirm and that it contradicts itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from plop.recordings.recording import Recording
from stages.calibrate.verify import CameraCheck, check_episode, spread_frames

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig


def contradicted(recorded: Recording, replaced: Recording, names: list[str], config: CalibrateConfig) -> dict[str, str]:
    """Name the cameras whose recorded pose agreed with the others and whose hand-eye pose does not.

    Args:
        recorded: With the poses as recorded.
        replaced: With hand-eye poses.
        names: Cameras that have a hand-eye pose.
        config: The limit of disagreement, frames and margin.

    Returns:
        Per camera why its recorded pose stays.
    """
    frames = spread_frames(len(recorded), config.check_frames)
    before, after = (check_episode(each, frames, config.region_margin_m) for each in (recorded, replaced))
    found = {}
    for name in names:
        if name in before and _agrees(before, name, config) and not _agrees(after, name, config):
            now = after[name].disagreement_mm
            found[name] = (
                f"the recorded pose agrees with the other cameras to {before[name].disagreement_mm:.1f} mm, "
                + (
                    "with the hand-eye pose it sees nothing that they see"
                    if now is None
                    else f"the hand-eye pose to {now:.1f} mm"
                )
                + ": check its axes (x right, y down, z forward), its frame and units"
            )
    return found


def _agrees(checks: Mapping[str, CameraCheck], name: str, config: CalibrateConfig) -> bool:
    value = checks[name].disagreement_mm
    return value is not None and value <= config.max_disagreement_mm
