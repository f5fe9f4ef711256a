"""Errors that tell a person what is wrong and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from plop.causes import Cause, by_cause

_SHOWN = 6
"""Warnings before a failure that are printed with it: more would bury it."""


class PlopError(Exception):
    """Report one problem: where it is, what was expected, what was found, what to do.

    Args:
        problem: One sentence that names the problem.
        where: File, key, episode or camera that it concerns.
        expected: What a correct input would have.
        found: What is there instead.
        fix: What the user can do next.
        cause: What it lies in, where an earlier fault could be the reason for it: see `first_cause`.
    """

    def __init__(
        self,
        problem: str,
        *,
        where: str | Path | None = None,
        expected: str | None = None,
        found: str | None = None,
        fix: str | None = None,
        cause: Cause | None = None,
    ) -> None:
        self.problem = problem
        self.where = None if where is None else str(where)
        self.expected = expected
        self.found = found
        self.fix = fix
        self.cause = cause
        self.noticed: list[str] = []
        """Warnings that were gathered before it, for `remembering`."""
        super().__init__(problem)

    def __str__(self) -> str:
        return self.render()

    def render(self) -> str:
        """Lay the parts out as lines of text, leaving out what is unknown."""
        rows = [("where", self.where), ("expected", self.expected), ("found", self.found)]
        rows += [("before it", text) for text in self.noticed[:_SHOWN]]
        if len(self.noticed) > _SHOWN:
            rows.append(("before it", f"{len(self.noticed) - _SHOWN} more"))
        rows.append(("fix", self.fix))
        return "\n".join([self.problem, *(f"  {name}: {value}" for name, value in rows if value)])

    def one_line(self) -> str:
        """Give the same on one line, as the reason why an episode is skipped."""
        return " | ".join(line.strip() for line in self.render().splitlines())

    def as_dict(self) -> dict[str, Any]:
        """Give the parts for `--json` output."""
        return {
            "problem": self.problem,
            "where": self.where,
            "expected": self.expected,
            "found": self.found,
            "fix": self.fix,
        } | ({"noticed": [str(text) for text in self.noticed]} if self.noticed else {})

    def first_cause(self) -> PlopError:
        """Give the error that names the first cause: this one, unless a warning before it explains it.

        A warning explains it when both know their cause and the warning's comes first (`Cause`). It then stands in
        front with its own advice; this error is what followed, and its advice comes second: how much of the one
        follows from the other is not judged.
        """
        first, *rest = by_cause(self.noticed) or [""]
        cause = getattr(first, "cause", None)
        if self.cause is None or cause is None or cause >= self.cause:
            return self
        advice = [getattr(first, "fix", ""), f"If this stays: {self.fix}" if self.fix else ""]
        found = self.problem + (f" Found: {self.found}" if self.found else "")
        lead = PlopError(
            first[:1].upper() + first[1:],
            where=self.where,
            found=f"because of it, perhaps: {found}",
            fix=" ".join(text for text in advice if text) or None,
            cause=cause,
        )
        lead.noticed = rest
        return lead


class UserCodeError(PlopError):
    """The user's own code is at fault: no other run of it will do better."""


class SignalTooWeakError(PlopError):
    """No amplitude of a hidden effect, inside its range, moves the object as far as was asked for."""


@contextmanager
def remembering(warnings: Sequence[str]) -> Iterator[None]:
    """Let a PlopError that is raised inside take along the warnings that were gathered before it.

    Args:
        warnings: Where they are gathered; read when the error comes by, so the list may grow inside.
    """
    try:
        yield
    except PlopError as error:
        error.noticed = list(dict.fromkeys([*warnings, *error.noticed]))
        raise
