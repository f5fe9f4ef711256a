"""A benchmark that goes on: each of its rows stands with the newest verdict that it has had.

A new version of `diagnose` does not empty the tables: a row that it has not judged yet stays as an older one left it,
with the version that did.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from stages.diagnose.stage import STAGE

Row = dict[str, Any]


def written_rows(path: Path) -> dict[str, Row]:
    """Give the rows of a result's file by their names; none where there is no file."""
    return {row["name"]: row for row in json.loads(path.read_text())["runs"]} if path.is_file() else {}


def is_judged(name: str, folder: Path, written: Mapping[str, Row]) -> bool:
    """Tell whether a run's row lies in the folder, or is written by the present version of `diagnose`."""
    return (folder / f"{name}.json").is_file() or written.get(name, {}).get("judged_by") == STAGE.version


def newest_rows(names: Iterable[str], folder: Path, written: Mapping[str, Row]) -> list[Row]:
    """Give the rows that there are, in order: the folder's before what is written."""
    rows = []
    for name in names:
        path = folder / f"{name}.json"
        if path.is_file():
            rows.append(json.loads(path.read_text()))
        elif name in written:
            rows.append(written[name])
    return rows


def shared(items: list[Any], share: str) -> list[Any]:
    """Give what the K-th of N processes takes: every N-th, for the share "K/N"."""
    number, of = map(int, share.split("/"))
    return items[number - 1 :: of]
