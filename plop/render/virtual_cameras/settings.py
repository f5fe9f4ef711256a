"""Settings of the virtual cameras that turn a simulated episode into a recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from plop.checked_settings import check_choices, check_ranges
from plop.errors import PlopError
from plop.render.virtual_cameras.texture import TEXTURES


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
    texture: Literal["waves", "dough"] = "waves"
    """What the object looks like: waves of strong colours, which the published results were recorded with, or dough,
    marbled in one warm colour, for people."""
    renderer: Literal["raycast", "blender"] = "raycast"
    """Who makes the colour: raycast needs nothing else, blender runs Cycles in Blender's own environment."""
    blender: str = field(default="blender", metadata={"in_fingerprint": False, "names_program": True})
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
    check_ranges(
        config,
        stage,
        {
            "size": (8, 8192),
            "cameras": (1, 1000),
            "fov_deg": (1, 150),
            "supersample": (1, 15),
            "blender_samples": (1, 1e5),
            "room_m": (0, 10),
            "depth_dropout": (0, 0.999),
            "depth_noise_m": (0, 0.1),
            "depth_quantization_m": (0, 0.1),
            "low_deg": (-89, 89),
            "high_deg": (-89, 89),
            "distance_m": (0, 100),
            "azimuth_deg": (-360, 360),
            "ambient": (0, 1),
            "directional": (0, 1),
        },
    )
    check_choices(config, stage, {"renderer": ("raycast", "blender"), "texture": TEXTURES})
    if config.supersample % 2 == 0:
        raise PlopError(
            "A setting is out of range.",
            where=f"{stage}.supersample",
            expected="an odd number",
            found=str(config.supersample),
            fix="Depth and mask use the middle ray.",
        )
