"""What is kept of a plan: plan.json of `plop plan`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from plop.artifacts.result_file import ResultFile
from plop.planning.motions import Change
from plop.planning.power import LawPower


@dataclass(frozen=True)
class MotionChoice:
    """One motion of the family, and how well it distinguishes."""

    motion: str
    like: str
    """The recorded episode that it is made from."""
    change: Change
    information: float
    """Expected log density ratio of the law that is there to the one most like it, less what a wrong response could
    feign, with two recordings of the motion beside the others [nats]; see plop/planning/separation.py."""


@dataclass(frozen=True)
class Separation:
    """What is to be distinguished, and by which motion."""

    laws: tuple[str, ...]
    """Laws, or settings of one."""
    choices: tuple[MotionChoice, ...]
    """The family, by information."""
    motion: str
    """The one that settles it with the fewest recordings."""
    information: float
    """Of the motions as they were recorded alone [nats]."""
    chance: float
    """Chance that these alone tell."""
    repeats: int
    """Recordings of that motion, in each set."""
    settled: float
    """Chance that a diagnosis then tells which law it is, where one of them is there."""


@dataclass(frozen=True)
class Step:
    """One motion of the protocol."""

    motion: str
    like: str
    change: Change
    repeats: int
    """How often it is recorded in the object to explain."""
    reference: int
    """How often in the one in which nothing is missing, beside the recordings that there are."""
    file: str = ""
    """The tool's path, where it is not one that was recorded."""


@dataclass(frozen=True)
class Plan(ResultFile):
    """What to record."""

    FILE: ClassVar[str] = "plan.json"
    COMMAND: ClassVar[str] = "plan"
    SCHEMA: ClassVar[int] = 2

    text: str
    """In words: what would be seen, what to record, in which order, and what then."""
    laws: tuple[LawPower, ...]
    """Those that are seen most easily first."""
    ways: tuple[int, ...]
    """Ways of dealing the episodes out, each motion recorded once, twice, ... in each set."""
    separation: Separation | None
    """None where nothing is to be distinguished."""
    steps: tuple[Step, ...]
    rounds: tuple[tuple[str, ...], ...]
    """Names of the motions in the order in which they are recorded, round by round, in each of the two objects."""
    episodes: tuple[str, ...]
    """Whose motions are repeated."""
    dropped: dict[str, str]
    """Episodes, motions and laws that were left out, with the reason."""
    environment: str
