"""Checks of the user's raw folder: existence and format."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from plop.errors import PlopError
from plop.recordings.readers.formats import PAGE, READ, Recognised, format_of, recognise

_ARCHIVES = (".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".zst", ".7z", ".rar")
_LISTED = 8


def check_raw_folder(path: Path, reader: str) -> None:
    """Reject a raw folder of another format; errors inside it are reported by the reader.

    Args:
        path: As the user gave it.
        reader: "droid", "disect" or "mesh".

    Raises:
        PlopError: It does not exist, is not a folder, is empty, or has another format, which is named with its command.
    """
    _check_there(path)
    wanted = format_of(reader)
    own = recognise(path, [wanted]) if path.is_dir() else None
    if own is not None and own.sight.folder == path:
        return
    found = own or _meant(path)
    if path.is_dir() and (found is None or (_has_own_files(path, reader) and not found.format.reader)):
        return  # the reader checks in detail, and reports missing or damaged files
    raise _other(path, found, f"a folder with {wanted.layout} ({wanted.name})", reader, ())


def _has_own_files(path: Path, reader: str) -> bool:
    """Return whether files are where a reader of single files expects them."""
    scenes = (file.with_suffix(".json").is_file() for file in path.glob("*.usd"))
    return reader != "droid" and (any(path.glob("*.npz")) or (reader == "disect" and any(scenes)))


def _meant(path: Path) -> Recognised | None:
    """Recognise a folder; for a file its folder, or else the file."""
    if path.is_file():
        beside = recognise(path.parent, READ)
        if beside is not None and (beside.format.reader == "droid" or beside.sight.folder == path.parent):
            return beside
    return recognise(path)


def ask_format(path: Path, rest: Sequence[str] = ()) -> PlopError:
    """Make the error for `plop ingest PATH` without a format, with a guess of the format.

    Args:
        path: As the user gave it.
        rest: Further arguments, repeated in the suggested command.
    """
    try:
        _check_there(path)
    except PlopError as error:
        error.expected = error.expected or _commands("PATH")
        return error
    return _other(path, _meant(path), _commands("PATH"), "", rest)


def _check_there(path: Path) -> None:
    if not path.exists():
        raise PlopError("There is no such folder.", where=path, found="nothing", fix=_nearest(path))
    if path.is_file() and (path.suffix.lower() in _ARCHIVES):
        raise PlopError(
            "This is an archive; plop reads folders.",
            where=path,
            found=f"a {path.suffix} file",
            fix="Unpack it, and give the folder that contains the recordings.",
        )
    if path.is_dir() and not any(path.iterdir()):
        raise PlopError(
            "The folder is empty.",
            where=path,
            found="no file",
            fix="Give the folder that contains the recordings, or copy them there.",
        )


def _other(path: Path, found: Recognised | None, expected: str, reader: str, rest: Sequence[str]) -> PlopError:
    """Return the actual content of a path, and what to do."""
    if found is None:
        what = "a file of an unknown format" if path.is_file() else _listed(path)
        return PlopError(
            f"The format of {path.name or path} is not recognised.",
            where=path,
            expected=expected,
            found=what,
            fix=f"{PAGE} describes the formats of recordings.",
        )
    form, sight = found.format, found.sight
    if form.reader:
        command = shlex.join(["plop", "ingest", form.reader, str(sight.folder), *rest])
        where = ", which lie in another folder." if form.reader == reader else "."
        problem = f"These look like {form.name}{where}" if reader else f"Name the format: these look like {form.name}."
        return PlopError(
            problem, where=path, expected=expected, found=f"{form.name}: {sight.by}", fix=f"Type: {command}"
        )
    fix = (
        f"The closest format that plop reads is `plop ingest {form.nearest}`: {form.advice}. See {PAGE}, Other formats."
    )
    return PlopError(
        f"This looks like a {form.name}, which plop does not read yet.",
        where=path,
        expected=expected,
        found=f"{form.name}: {sight.by}",
        fix=fix,
    )


def _commands(path: str) -> str:
    rows = [f"plop ingest {each.reader} {path}   {each.name}: {each.layout}" for each in READ]
    return "one of\n    " + "\n    ".join(rows)


def _listed(path: Path) -> str:
    names = sorted(entry.name + ("/" if entry.is_dir() else "") for entry in path.iterdir())
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")


def _nearest(path: Path) -> str:
    """Suggest existing names similar to the missing part of a path."""
    missing = path
    while missing.parent != missing and not missing.parent.exists():
        missing = missing.parent
    if not missing.parent.is_dir():
        return f"{missing.parent} is a file: correct the path."
    try:
        there = {entry.name.lower(): entry for entry in missing.parent.iterdir() if not entry.name.startswith(".")}
    except OSError:
        there = {}
    close = get_close_matches(missing.name.lower(), list(there), n=3)
    if close:
        return f"Did you mean {' or '.join(str(there[name]) for name in close)}?"
    return f"{missing.parent} has no {missing.name}: correct the path."
