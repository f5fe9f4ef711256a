"""Settings of the virtual cameras that record a simulated episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from plop.errors import PlopError
from plop.render.virtual_cameras.texture import Texture
from plop.setting_kinds import COMMON, PROGRAM, SAME_RESULT, Formerly, Range, Settings, Share, Unit


@dataclass(frozen=True)
class CameraSettings(Settings):
    """Cameras, light and depth sensors; their defaults are defined only here."""

    count: Annotated[int, Range(1, 1000), COMMON, Formerly("cameras")] = 6
    """Number of cameras, alternately on the low and on the high ring."""
    size: Annotated[int, Range(8, 8192), Unit("px"), COMMON] = 128
    """Width and height of the images."""
    fov_deg: Annotated[float, Range(1, 150), Unit("deg")] = 35.0
    """Full field of view."""
    low_deg: Annotated[float, Range(-89, 89), Unit("deg")] = 25.0
    """Elevation of the low ring."""
    high_deg: Annotated[float, Range(-89, 89), Unit("deg")] = 55.0
    """Elevation of the high ring."""
    azimuth_deg: Annotated[float, Range(-360, 360), Unit("deg")] = 30.0
    """Direction of the first camera, from x towards y."""
    room_m: Annotated[float, Range(0, 10), Unit("m")] = 0.025
    """Free space around the object at rest that stays in view."""
    distance_m: Annotated[float, Range(0, 100), Unit("m")] = 0.0
    """Distance of the cameras from the object's middle; 0 fits object and room into the image."""
    supersample: Annotated[int, Range(1, 15), Unit("rays")] = 3
    """Rays along each side of a pixel for the colour; odd. Depth and mask use the middle ray."""
    ambient: Share = 0.75
    """Brightness without the lamp."""
    directional: Share = 0.25
    """Brightness that the lamp adds."""
    texture: Annotated[Texture, COMMON] = "waves"
    """Texture of the object: waves of strong colours, as in the published results, or dough, marbled in one warm
    colour, for presentation."""
    renderer: Literal["raycast", "blender"] = "raycast"
    """Renderer of the colour: raycast needs nothing else, blender runs Cycles in Blender's own environment."""
    blender: Annotated[str, SAME_RESULT, PROGRAM] = "blender"
    """Blender's executable, or a Python that has the package bpy."""
    blender_samples: Annotated[int, Range(1, 1e5), Unit("samples")] = 16
    """Cycles samples per pixel."""
    depth_noise_m: Annotated[float, Range(0, 0.1), Unit("m"), COMMON] = 0.0
    """Standard deviation of noise added to depth."""
    depth_quantization_m: Annotated[float, Range(0, 0.1), Unit("m")] = 0.0
    """Step that depth is rounded to; 0 disables rounding."""
    depth_dropout: Annotated[float, Range(0, 0.999)] = 0.0
    """Probability that a pixel's depth is not measured."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.supersample % 2 == 0:
            raise PlopError(
                "A setting is out of range.",
                where="cameras.supersample",
                expected="an odd number",
                found=str(self.supersample),
                fix="Depth and mask use the middle ray.",
            )
