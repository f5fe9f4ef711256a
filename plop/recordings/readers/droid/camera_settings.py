"""Settings and side files by which DROID cameras are read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from plop.setting_kinds import Formerly, Range, Settings, Unit


@dataclass(frozen=True)
class DroidCameraSettings(Settings):
    """Settings of DROID cameras; the defaults are defined only here."""

    exterior_focal_px: Annotated[float, Range(0, 1e5), Unit("px")] = 0.0
    """Focal length of exterior cameras without intrinsics, at 1280 px width (ZED 2: about 530); 0 = none."""
    wrist_focal_px: Annotated[float, Range(0, 1e5), Unit("px")] = 0.0
    """Focal length of a wrist camera without intrinsics, at 1280 px width (ZED Mini: about 733); 0 = none."""
    baseline_m: Annotated[float, Range(0, 1), Unit("m")] = 0.0
    """Baseline of every stereo camera; 0 = from its left and right extrinsics."""
    match_width: Annotated[int, Range(16, 8192), Unit("px")] = 640
    """Width at which stereo pairs are matched."""
    nearest_m: Annotated[float, Range(0.01, 100), Unit("m")] = 0.2
    """Smallest depth in stereo matching."""
    farthest_m: Annotated[float, Range(0.01, 1000), Unit("m")] = 2.5
    """Largest stereo depth; larger values are discarded."""
    delay_ms: Annotated[float, Range(-1e4, 1e4), Unit("ms"), Formerly("camera_delay_ms")] = 0.0
    """Delay between the capture of an image and its time stamp; `plop calibrate` measures it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_order("The largest depth is smaller than the smallest.", "nearest_m", "farthest_m", "cameras.")


@dataclass(frozen=True)
class DroidOptions:
    """Sources for reading DROID cameras."""

    settings: DroidCameraSettings
    intrinsics: dict[str, Any]
    """Intrinsics of a file beside the episodes, by serial number."""
    intrinsics_name: str
    """That file."""
    extrinsics: dict[str, Any]
    """Poses of a file beside the episodes, by episode."""
    extrinsics_name: str
