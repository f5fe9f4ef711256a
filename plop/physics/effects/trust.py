"""Effect files that came inside an artifact run only once their user has trusted them.

An effect file is a program. One that the user names with --effect-file is their own choice; one that came with a
model may be a stranger's. It runs from a copy in the user's own folder, named by the digest of its content, which is
made when the user says so: other content is another file, and what lies beside the original (byte code, kernel caches,
which Python and numba would load unasked) is never read.
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
"""Environment variable: "1" trusts every effect file that is met. Processes started for a run inherit it."""


class UntrustedEffectError(PlopError):
    """A model holds effect files whose content nobody here has trusted."""

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = list(files)
        super().__init__(
            "This model holds a program of somebody's own, and would run it.",
            where=", ".join(map(str, files)),
            expected="effect files that you have read and trust",
            found="content that was not trusted here before",
            fix="Read the file; then repeat the command with --trust-effects (remembered for this content only).",
        )


def trusted_copies(files: Sequence[Path]) -> list[Path]:
    """Give the copies that may run of effect files that came inside an artifact.

    Raises:
        UntrustedEffectError: The content of some was never trusted.
    """
    asked = os.environ.get(TRUST) == "1"
    copies = [_remembered(path) if asked else _known_copy(path) for path in files]
    if None in copies:
        raise UntrustedEffectError([path for path, copy in zip(files, copies, strict=True) if copy is None])
    return [copy for copy in copies if copy is not None]


def remember(path: Path) -> None:
    """Trust a file of the user's own from now on, also inside artifacts; no matter where it cannot be remembered."""
    try:
        _remembered(path)
    except OSError:
        return  # a read-only home: --trust-effects or the environment variable will be asked for


@contextmanager
def trusting(wanted: bool) -> Iterator[None]:
    """Trust every effect file met inside the block, in this process and those it starts, if `wanted`."""
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
    """Give the user's folder of trusted copies; deleting one withdraws the trust."""
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
