"""Trust in effect files: those inside an artifact run only after the user has trusted them.

An effect file is a program. One that the user names with --effect-file is their own choice; one that came with a
model may be from an unknown author. It runs from a copy in the user's own folder, named by the digest of its content
and made when the user trusts it: changed content is a new file, and files beside the original (byte code and kernel
caches, which Python and numba load automatically) are never read.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from plop.artifacts.atomic_file import whole
from plop.errors import PlopError

TRUST = "PLOP_TRUST_EFFECTS"
"""Environment variable: "1" trusts every effect file. Processes started for a run inherit it."""


class UntrustedEffectError(PlopError):
    """A model contains effect files whose content the user has not trusted."""

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = list(files)
        super().__init__(
            "This model contains an effect file, a program that would run here.",
            where=", ".join(map(str, files)),
            expected="effect files that you have read and trust",
            found="content that was not trusted before",
            fix="Read the file; then repeat the command with --trust-effects (remembered for this content only).",
        )


def trusted_copies(files: Sequence[Path]) -> list[Path]:
    """Return the trusted copies of effect files inside an artifact.

    Raises:
        UntrustedEffectError: The content of some is not trusted.
    """
    asked = os.environ.get(TRUST) == "1"
    copies = [_remembered(path) if asked else _known_copy(path) for path in files]
    if None in copies:
        raise UntrustedEffectError([path for path, copy in zip(files, copies, strict=True) if copy is None])
    return [copy for copy in copies if copy is not None]


def remember(path: Path) -> None:
    """Trust a user's own file from now on, also inside artifacts; ignored where this cannot be stored."""
    try:
        _remembered(path)
    except OSError:
        return  # a read-only home: --trust-effects or the environment variable is needed later


@contextmanager
def trusting(wanted: bool) -> Iterator[None]:
    """Trust every effect file inside the block, in this process and its children, if `wanted`."""
    before = os.environ.get(TRUST)
    if wanted:
        os.environ[TRUST] = "1"
    try:
        yield
    finally:
        if wanted:
            os.environ.pop(TRUST)
            os.environ.update({} if before is None else {TRUST: before})


def folder() -> Path:
    """Return the user's folder of trusted copies; deleting one withdraws the trust."""
    config = os.environ.get("XDG_CONFIG_HOME")
    return (Path(config) if config else Path.home() / ".config") / "plop" / "trusted-effects"


def _copy_of(path: Path, content: bytes) -> Path:
    return folder() / hashlib.sha256(content).hexdigest() / path.name


def _known_copy(path: Path) -> Path | None:
    content = path.read_bytes()
    copy = _copy_of(path, content)
    return copy if copy.is_file() and copy.read_bytes() == content else None


def _remembered(path: Path) -> Path:
    content = path.read_bytes()
    copy = _copy_of(path, content)
    if _known_copy(path) is None:
        with whole(copy) as scratch:
            scratch.write_bytes(content)
    return copy
