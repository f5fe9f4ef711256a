"""Names that users give to artifacts with --name: artifacts/names.json."""

from __future__ import annotations

import json
import re
from pathlib import Path

from plop.artifacts.atomic_file import write_json
from plop.artifacts.lock import locked
from plop.errors import PlopError

_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]*")
_FILE = "names.json"


def read_names(root: Path) -> dict[str, str]:
    """Return all names below artifacts/: name -> full address.

    Raises:
        PlopError: The file is damaged.
    """
    path = root / _FILE
    if not path.exists():
        return {}
    try:
        return {str(k): str(v) for k, v in json.loads(path.read_text(encoding="utf-8")).items()}
    except (OSError, ValueError, AttributeError) as error:
        raise PlopError(
            "The names of artifacts cannot be read.",
            where=path,
            found=str(error),
            fix="Remove the file; the artifacts are kept and can be named again.",
        ) from error


def give_name(root: Path, name: str, address: str) -> str | None:
    """Name an artifact below artifacts/; a name that was used before moves to the new one.

    Returns:
        Full address of the artifact that had the name before; None when there was none.
    """
    check_name(name)
    with locked(root / ".locks" / "names"):
        names = read_names(root)
        write_json(root / _FILE, names | {name: address})
    before = names.get(name, address)
    return None if before == address else before


def check_name(name: str) -> None:
    """Reject a name that could be mistaken for an address or a path.

    Raises:
        PlopError: It could.
    """
    if not _PATTERN.fullmatch(name) or name == "latest":
        raise PlopError(
            "This is not a valid name of an artifact.",
            where=name,
            expected="letters, digits, '.', '_', '+', '-'; first a letter or digit",
        )
