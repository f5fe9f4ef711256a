"""The JSON file beside a raw episode of a simulator, and the episodes of a folder as those files tell them."""

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
    """One raw episode in a folder, not read yet."""

    name: str
    environment: str
    """Shape and material, e.g. "prism-jelly"."""
    path: Path
    """File that its reader opens."""
    guessed: bool = False
    """The environment is what the name tells: the JSON file is missing or damaged."""


def read_json(path: Path) -> Any:
    """Read a JSON file that a person or another program wrote: UTF-8 or, as some Windows programs, UTF-16; a byte
    order mark or none.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no JSON, or of another encoding.
    """
    return json.loads(path.read_bytes())


def raw_episode(path: Path, read: Callable[[Path], Mapping[str, Any]], guess: Callable[[str], str]) -> RawEpisode:
    """List one episode, reading only its JSON file; one whose JSON cannot be read has a guessed environment.

    Args:
        path: File that its reader opens; the JSON lies beside it.
        read: Reads and checks the JSON file.
        guess: Environment that a name tells.
    """
    try:
        return RawEpisode(path.stem, read(path.with_suffix(".json"))["environment"], path)
    except PlopError:
        return RawEpisode(path.stem, guess(path.stem), path, guessed=True)


def known_environments(entries: Iterable[RawEpisode]) -> list[str]:
    """Give the environments that JSON files tell, sorted; what names tell only where no file tells any."""
    entries = list(entries)
    return sorted({e.environment for e in entries if not e.guessed} or {e.environment for e in entries})


def read_side_file(path: Path, kinds: Mapping[str, type], *, fix: str) -> dict[str, Any]:
    """Read the JSON file of an episode.

    Args:
        path: The file.
        kinds: What each key holds where it is there, e.g. {"units": dict}.
        fix: What to do about a file that is missing or damaged.

    Raises:
        PlopError: It is missing, no JSON, no object, or a key holds something else; names file and key.
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
                "The episode's JSON file holds something else than it should.",
                where=where,
                expected=_KINDS[kind],
                found=f"{_KINDS[type(value)]}: {json.dumps(value)[:40]}",
                fix=f"Correct the file. {fix}",
            )
    return side


def check_has_environment(side: Mapping[str, Any], path: Path, *, fix: str) -> None:
    """Raise PlopError when a JSON file does not tell the environment."""
    if "environment" not in side:
        raise PlopError(
            "The episode's JSON file tells no environment.",
            where=f"{path}: environment",
            expected='a text, e.g. "prism-jelly"',
            found="nothing",
            fix=fix,
        )
