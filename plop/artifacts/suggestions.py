"""Suggestions: artifacts that resemble an address, and workspaces near a folder that is not one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from difflib import SequenceMatcher
from pathlib import Path
from typing import Protocol

_LIKE = 0.6
"""Smallest similarity of a suggestion (difflib's default)."""
_TOLD, _LATEST = 3, 6
_STEPS = ((60, "s", 1), (3600, "min", 60), (48 * 3600, "h", 3600), (float("inf"), "days", 86400))


class Known(Protocol):
    """The fields of an artifact that a suggestion shows."""

    @property
    def key(self) -> tuple[str, str]: ...  # noqa: D102
    @property
    def address(self) -> str: ...  # noqa: D102
    @property
    def made(self) -> str: ...  # noqa: D102


def age(made: str, now: datetime | None = None) -> str:
    """Write how long ago a moment was, e.g. "5 min ago"; "" when it is not known.

    Args:
        made: ISO date and time.
        now: Reference time; the present when absent.
    """
    try:
        seconds = max(0.0, ((now or datetime.now(UTC)) - datetime.fromisoformat(made)).total_seconds())
    except (TypeError, ValueError):
        return ""
    unit, size = next((unit, size) for limit, unit, size in _STEPS if seconds < limit)
    return f"{seconds / size:.0f} {unit} ago"


def nearest(address: str, artifacts: Sequence[Known], names: Mapping[str, str]) -> list[str]:
    """List the artifacts that resemble an address, the likeliest first; the latest where none does.

    Args:
        address: What the user wrote: `stage@prefix`, a name, a stage or a fingerprint alone.
        artifacts: All there are, least recently used first.
        names: Name -> full address.

    Returns:
        Lines such as "base = train@3f9a1c04, 2 h ago".
    """
    by_full = {"@".join(each.key): each for each in artifacts}
    called = {full: name for name, full in names.items() if full in by_full}
    scored = [
        (_likeness(address, each, called.get(full, "")), place, full)
        for place, (full, each) in enumerate(by_full.items())
    ]
    best = sorted(scored, reverse=True)[:_TOLD]
    chosen = [full for score, _, full in best if score >= _LIKE] or [full for *_, full in scored[: -_LATEST - 1 : -1]]
    return [description(by_full[full], called.get(full, "")) for full in chosen]


def description(artifact: Known, name: str = "") -> str:
    """Write one artifact with its name and age."""
    made = age(artifact.made)
    return (f"{name} = " if name else "") + artifact.address + (f", {made}" if made else "")


def _likeness(address: str, artifact: Known, name: str) -> float:
    """Return the similarity to the closest address of an artifact, 0 to 1."""
    stage, mark = artifact.key
    asked_stage, _, asked = address.partition("@")
    ways = [name, stage, mark[: len(address)], f"{stage}@{mark[: max(len(asked), 4)]}"]
    if asked == "latest" or not asked:
        ways.append(f"{stage}@{asked}")
    score = max(SequenceMatcher(None, address.lower(), way.lower()).ratio() for way in ways if way)
    return score + (0.2 if asked and asked_stage == stage else 0)  # the stage is a word and rarely the wrong one


def workspaces_near(folder: Path) -> list[Path]:
    """Find workspaces above, beside and below a folder that is not one, nearest first."""
    there = next(path for path in (folder, *folder.parents) if path.is_dir())
    around = [there, *there.parents[:3]]
    with suppress(OSError):
        around += sorted(entry for entry in there.iterdir() if entry.is_dir() and not entry.name.startswith("."))[:200]
    found = [path for path in around if path != folder and any((path / "artifacts").glob("*/*/manifest.json"))]
    return sorted(found, key=lambda path: -SequenceMatcher(None, path.name.lower(), folder.name.lower()).ratio())
