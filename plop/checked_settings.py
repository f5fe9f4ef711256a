"""Refuse settings that make no sense, by name, before any work is done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from plop.errors import PlopError


def check_ranges(config: object, stage: str, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse numbers outside their range.

    Args:
        config: The settings.
        stage: The command whose they are, for the message.
        ranges: Setting -> least and largest value.

    Raises:
        PlopError: Names the setting, its range and its value.
    """
    for name, (low, high) in ranges.items():
        value = getattr(config, name)
        if not low <= value <= high:
            expected = f"{low:g} or more" if high == float("inf") else f"{low:g} to {high:g}"
            raise PlopError(
                "A setting is out of range.",
                where=_key(stage, name),
                expected=expected,
                found=str(value),
                fix=f"`plop {stage} --help` tells unit and default.",
            )


def check_choices(config: object, stage: str, choices: Mapping[str, Sequence[str]]) -> None:
    """Refuse words that are none of the known ones.

    Raises:
        PlopError: Names the setting, the known words and the one found.
    """
    for name, known in choices.items():
        if getattr(config, name) not in known:
            raise PlopError(
                "This setting is unknown.",
                where=_key(stage, name),
                expected=" or ".join(known),
                found=str(getattr(config, name)),
                fix=f"`plop {stage} --help` tells what each does.",
            )


def _key(stage: str, name: str) -> str:
    """Name a setting as `--set` takes it."""
    return f"{stage.replace(' ', '.')}.{name}"


class HasJobs(Protocol):
    """Settings of a stage that works in several processes."""

    @property
    def jobs(self) -> int:
        """Processes; -1 is one a core."""
        ...


def check_jobs(config: HasJobs, stage: str) -> None:
    """Refuse no processes at all.

    Raises:
        PlopError: `jobs` is 0.
    """
    if config.jobs == 0:
        raise PlopError(
            "A setting is out of range.",
            where=f"{stage}.jobs",
            expected="1 or more; -1 is one a core",
            found="0",
            fix="Leave it out to use all cores.",
        )
