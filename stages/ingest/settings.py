"""Settings of `ingest disect` and `ingest mesh`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from plop.render.virtual_cameras.settings import CameraSettings
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Seed, Settings, Unit


@dataclass(frozen=True)
class SimulatedConfig(Settings):
    """Settings that every ingest of a simulator shares."""

    cameras: CameraSettings = CameraSettings()
    """Cameras, light and depth sensors."""
    environment: Annotated[str, COMMON] = ""
    """Environment to use, e.g. "prism-jelly"; empty uses the only one in the folder."""
    episodes: Annotated[str, COMMON] = "*"
    """Glob over the names of the episodes to use."""
    test: Annotated[tuple[str, ...], COMMON] = ()
    """Globs of the test episodes; empty selects the last quarter of the names, at least one."""
    skip_bad: Annotated[bool, COMMON] = False
    """Leave out episodes that cannot be read, with the reason, instead of stopping."""
    keep_untouched: bool = False
    """Keep episodes in which the tool never comes within 3 mm of the object, as in a free fall."""
    workspace_m: Annotated[float, Range(1e-3, 100), Unit("m")] = 1.0
    """Largest initial distance of the object from the world's origin."""
    largest_m: Annotated[float, Range(1e-6, 100), Unit("m")] = 0.5
    """Longest edge of object and tool; larger values indicate another unit."""
    smallest_m: Annotated[float, Range(1e-6, 100), Unit("m")] = 0.02
    """Smallest longest edge of the larger of object and tool; smaller values indicate another unit."""
    fault: tuple[str, ...] = ()
    """Sensor fault to record with, as `simulate --fault`: NAME=VALUE of the first camera or of the tool, or
    NAME=VALUE@CAMERA."""
    from_rest: bool = False
    """Start at time 0 with the rest shape where the first frame is later. DiSECt releases an object at time 0
    and stores the first frame 1/30 s later, while it bounces: its speed is unknown from a recording alone."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""
    seed: Annotated[Seed, COMMON] = 0
    """Seed of texture and noise; the texture depends on it and on the environment's name only."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_order("The largest size is smaller than the smallest.", "smallest_m", "largest_m")


@dataclass(frozen=True)
class DisectConfig(SimulatedConfig):
    """Settings of `ingest disect`."""

    test: Annotated[tuple[str, ...], COMMON] = ("*_part_004", "*_part_005", "*[!t]_001")
    """Globs of the test episodes: part recordings 004 and 005, and plain cuts 001
    (`[!t]` excludes part_001); empty selects the last quarter of the names."""


@dataclass(frozen=True)
class MeshConfig(SimulatedConfig):
    """Settings of `ingest mesh`."""
