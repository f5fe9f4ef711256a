"""Settings of `ingest disect` and `ingest mesh`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from plop.errors import PlopError


@dataclass(frozen=True)
class SimulatedConfig:
    """Settings that every ingest of a simulator shares; their defaults are written only here."""

    environment: str = ""
    """Environment to take, e.g. "prism-jelly"; empty takes the only one in the folder."""
    episodes: str = "*"
    """Glob over the names of the episodes to take."""
    test: tuple[str, ...] = ()
    """Globs of the episodes kept for the test; none keeps the last quarter of the names, at least one."""
    skip_bad: bool = False
    """Leave out episodes that cannot be read, with the reason, instead of stopping."""
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
    workspace_m: float = 1.0
    """Farthest distance from the world's origin at which the object may start [m]."""
    seed: int = 0
    """Seed of texture and noise; the texture depends on it and on the environment's name only."""


@dataclass(frozen=True)
class DisectConfig(SimulatedConfig):
    """Settings of `ingest disect`."""

    test: tuple[str, ...] = ("*_part_004", "*_part_005", "*[!t]_001")
    """Globs of the episodes kept for the test: part recordings 004 and 005, and plain cuts 001
    (`[!t]` spares part_001); none keeps the last quarter of the names."""


@dataclass(frozen=True)
class MeshConfig(SimulatedConfig):
    """Settings of `ingest mesh`."""


def check_config(config: SimulatedConfig) -> None:
    """Refuse settings outside their range.

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
        "workspace_m": config.workspace_m <= 0,
        "depth_dropout": not 0 <= config.depth_dropout < 1,
        "depth_noise_m": config.depth_noise_m < 0,
        "depth_quantization_m": config.depth_quantization_m < 0,
        "low_deg": not -90 < config.low_deg < 90,
        "high_deg": not -90 < config.high_deg < 90,
        "distance_m": config.distance_m < 0,
    }
    for key, is_wrong in wrong.items():
        if is_wrong:
            raise PlopError(f"The setting {key} is out of range.", where=f"ingest.{key}",
                            expected="see `plop ingest --help`", found=str(getattr(config, key)))  # fmt: skip
