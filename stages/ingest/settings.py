"""Settings of `ingest disect` and `ingest mesh`."""

from __future__ import annotations

from dataclasses import dataclass, field

from plop.checked_settings import check_jobs, check_ranges
from plop.render.virtual_cameras.settings import CameraSettings, check_cameras


@dataclass(frozen=True)
class SimulatedConfig(CameraSettings):
    """Settings that every ingest of a simulator shares, besides those of the cameras."""

    environment: str = ""
    """Environment to take, e.g. "prism-jelly"; empty takes the only one in the folder."""
    episodes: str = "*"
    """Glob over the names of the episodes to take."""
    test: tuple[str, ...] = ()
    """Globs of the episodes kept for the test; none keeps the last quarter of the names, at least one."""
    skip_bad: bool = False
    """Leave out episodes that cannot be read, with the reason, instead of stopping."""
    keep_untouched: bool = False
    """Keep episodes in which the tool never comes within 3 mm of the object, as in a free fall."""
    workspace_m: float = 1.0
    """Farthest distance from the world's origin at which the object may start [m]."""
    largest_m: float = 0.5
    """Longest edge that object and tool may have; what is larger is taken for another unit [m]."""
    smallest_m: float = 0.02
    """Longest edge that the larger of object and tool must have; what is smaller is taken for another unit [m]."""
    from_rest: bool = False
    """Begin at time 0 with the rest shape where the first frame lies later. DiSECt lets an object go at time 0
    and stores the first frame 1/30 s later, while it bounces: from a recording alone its speed cannot be known."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core."""


@dataclass(frozen=True)
class DisectConfig(SimulatedConfig):
    """Settings of `ingest disect`."""

    test: tuple[str, ...] = ("*_part_004", "*_part_005", "*[!t]_001")
    """Globs of the episodes kept for the test: part recordings 004 and 005, and plain cuts 001
    (`[!t]` spares part_001); none keeps the last quarter of the names."""


@dataclass(frozen=True)
class MeshConfig(SimulatedConfig):
    """Settings of `ingest mesh`."""


def check_config(command: str, config: SimulatedConfig) -> None:
    """Refuse settings of `ingest disect` or `ingest mesh` outside their range.

    Raises:
        PlopError: Names the setting.
    """
    check_cameras(config, command)
    check_jobs(config, command)
    check_ranges(
        config, command, {"workspace_m": (1e-3, 100), "smallest_m": (1e-6, 100), "largest_m": (config.smallest_m, 100)}
    )
