"""Settings of the virtual cameras that turn a simulated episode into a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from plop.errors import PlopError


@dataclass(frozen=True)
class CameraSettings:
    """Cameras, light and depth sensors; their defaults are written only here."""

    size: int = 128
    """Width and height of the images [px]."""
    cameras: int = 6
    """Number of cameras, alternately on the low and on the high ring."""
    fov_deg: float = 35.0
    """Full field of view [deg]."""
    low_deg: float = 25.0
    """Elevation of the low ring [deg]."""
    high_deg: float = 55.0
    """Elevation of the high ring [deg]."""
    azimuth_deg: float = 30.0
    """Direction of the first camera, from x towards y [deg]."""
    room_m: float = 0.025
    """Free space around the object at rest that stays in view [m]."""
    distance_m: float = 0.0
    """Distance of the cameras from the object's middle [m]; 0 fits object and room into the image."""
    supersample: int = 3
    """Rays along each side of a pixel for the colour; odd. Depth and mask use the middle ray."""
    ambient: float = 0.75
    """Brightness without the lamp, 0..1."""
    directional: float = 0.25
    """Brightness that the lamp adds, 0..1."""
    renderer: Literal["raycast", "blender"] = "raycast"
    """Who makes the colour: raycast needs nothing else, blender runs Cycles in Blender's own environment."""
    blender: str = field(default="blender", metadata={"in_fingerprint": False})
    """Blender's executable, or a Python that has the package bpy."""
    blender_samples: int = 16
    """Cycles samples a pixel."""
    depth_noise_m: float = 0.0
    """Standard deviation of noise added to depth [m]."""
    depth_quantization_m: float = 0.0
    """Step that depth is rounded to [m]; 0 rounds nothing."""
    depth_dropout: float = 0.0
    """Probability that a pixel's depth is not measured."""
    seed: int = 0
    """Seed of texture and noise; the texture depends on it and on the environment's name only."""


def check_cameras(config: CameraSettings, stage: str) -> None:
    """Refuse settings outside their range.

    Args:
        config: The settings.
        stage: Whose they are, for messages.

    Raises:
        PlopError: Names the setting.
    """
    wrong = {
        "size": config.size < 8,
        "cameras": config.cameras < 1,
        "fov_deg": not 1 <= config.fov_deg <= 150,
        "supersample": config.supersample < 1 or config.supersample % 2 == 0,
        "renderer": config.renderer not in ("raycast", "blender"),
        "blender_samples": config.blender_samples < 1,
        "room_m": config.room_m < 0,
        "depth_dropout": not 0 <= config.depth_dropout < 1,
        "depth_noise_m": config.depth_noise_m < 0,
        "depth_quantization_m": config.depth_quantization_m < 0,
        "low_deg": not -90 < config.low_deg < 90,
        "high_deg": not -90 < config.high_deg < 90,
        "distance_m": config.distance_m < 0,
    }
    refuse_wrong(wrong, config, stage)


def refuse_wrong(wrong: dict[str, bool], config: object, stage: str) -> None:
    """Name the first setting that is out of range.

    Raises:
        PlopError: One of them is.
    """
    for key, is_wrong in wrong.items():
        if is_wrong:
            raise PlopError(f"The setting {key} is out of range.", where=f"{stage}.{key}",
                            expected=f"see `plop {stage} --help`", found=str(getattr(config, key)))  # fmt: skip
