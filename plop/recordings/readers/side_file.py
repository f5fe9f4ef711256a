"""The JSON file beside a raw episode of a simulator, and the list of episodes from these files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.errors import PlopError

_KINDS = {
    dict: "an object",
    list: "a list",
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    type(None): "null",
}


@dataclass(frozen=True)
class RawEpisode:
    """One unread raw episode in a folder."""

    name: str
    environment: str
    """Shape and material, e.g. "prism-jelly"."""
    path: Path
    """File that its reader opens."""
    guessed: bool = False
    """Whether the environment is guessed from the name, because the JSON file is missing or damaged."""


def read_json(path: Path) -> Any:
    """Read a JSON file written by a person or another program: UTF-8 or, as by some Windows programs, UTF-16, with or
    without a byte order mark.

    Raises:
        OSError: It cannot be read.
        ValueError: It is not JSON, or has another encoding.
    """
    return json.loads(path.read_bytes())


def raw_episode(path: Path, read: Callable[[Path], Mapping[str, Any]], guess: Callable[[str], str]) -> RawEpisode:
    """List one episode, reading only its JSON file; one whose JSON cannot be read has a guessed environment.

    Args:
        path: File that its reader opens; the JSON lies beside it.
        read: Reads and checks the JSON file.
        guess: Returns the environment from a name.
    """
    try:
        return RawEpisode(path.stem, read(path.with_suffix(".json"))["environment"], path)
    except PlopError:
        return RawEpisode(path.stem, guess(path.stem), path, guessed=True)


def known_environments(entries: Iterable[RawEpisode]) -> list[str]:
    """Return the environments from JSON files, sorted; those from names only where no file has one."""
    entries = list(entries)
    return sorted({e.environment for e in entries if not e.guessed} or {e.environment for e in entries})


def read_side_file(path: Path, kinds: Mapping[str, type], *, fix: str) -> dict[str, Any]:
    """Read the JSON file of an episode.

    Args:
        path: The file.
        kinds: Type of each optional key, e.g. {"units": dict}.
        fix: What to do about a file that is missing or damaged.

    Raises:
        PlopError: It is missing, not JSON, not an object, or a key has another type; names file and key.
    """
    try:
        side = read_json(path)
    except (OSError, ValueError) as error:
        raise PlopError(
            "The episode's JSON file is missing or damaged.",
            where=path,
            expected="a JSON object",
            found=f"{type(error).__name__}: {error}",
            fix=fix,
        ) from error
    held: dict[str, tuple[object, type]] = {str(path): (side, dict)}
    if isinstance(side, dict):
        held |= {f"{path}: {key}": (side[key], kind) for key, kind in kinds.items() if key in side}
    for where, (value, kind) in held.items():
        if type(value) is not kind:
            raise PlopError(
                "A key of the episode's JSON file has the wrong type.",
                where=where,
                expected=_KINDS[kind],
                found=f"{_KINDS[type(value)]}: {json.dumps(value)[:40]}",
                fix=f"Correct the file. {fix}",
            )
    return side


def check_has_environment(side: Mapping[str, Any], path: Path, *, fix: str) -> None:
    """Raise PlopError when a JSON file has no environment."""
    if "environment" not in side:
        raise PlopError(
            "The episode's JSON file has no environment.",
            where=f"{path}: environment",
            expected='a text, e.g. "prism-jelly"',
            found="nothing",
            fix=fix,
        )
