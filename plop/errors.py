"""Errors that state what is wrong and what to do next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from plop.causes import Cause, by_cause

_SHOWN = 6
"""Largest number of earlier warnings printed with an error."""


class PlopError(Exception):
    """Report one problem: where it is, what was expected, what was found, what to do.

    Args:
        problem: One sentence that names the problem.
        where: File, key, episode or camera that it concerns.
        expected: What a correct input would have.
        found: What is there instead.
        fix: What the user can do next.
        cause: Its cause, where an earlier fault could explain it: see `first_cause`.
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
        """Warnings collected before it, by `remembering`."""
        super().__init__(problem)

    def __str__(self) -> str:
        return self.render()

    def render(self) -> str:
        """Format the parts as lines of text, leaving out unknown ones."""
        rows = [("where", self.where), ("expected", self.expected), ("found", self.found)]
        rows += [("before it", text) for text in self.noticed[:_SHOWN]]
        if len(self.noticed) > _SHOWN:
            rows.append(("before it", f"{len(self.noticed) - _SHOWN} more"))
        rows.append(("fix", self.fix))
        return "\n".join([self.problem, *(f"  {name}: {value}" for name, value in rows if value)])

    def one_line(self) -> str:
        """Return the error on one line, as the reason why an episode is skipped."""
        return " | ".join(line.strip() for line in self.render().splitlines())

    def as_dict(self) -> dict[str, Any]:
        """Return the parts for `--json` output."""
        return {
            "problem": self.problem,
            "where": self.where,
            "expected": self.expected,
            "found": self.found,
            "fix": self.fix,
        } | ({"noticed": [str(text) for text in self.noticed]} if self.noticed else {})

    def first_cause(self) -> PlopError:
        """Return the error that names the first cause: this one, unless a warning before it explains it.

        A warning explains it when both have a cause and the warning's comes first (`Cause`). The warning and its advice
        are then reported first; this error and its advice follow: how far one explains the other is not determined.
        """
        first, *rest = by_cause(self.noticed) or [""]
        cause = getattr(first, "cause", None)
        if self.cause is None or cause is None or cause >= self.cause:
            return self
        advice = [getattr(first, "fix", ""), f"If the problem persists: {self.fix}" if self.fix else ""]
        found = self.problem + (f" Found: {self.found}" if self.found else "")
        lead = PlopError(
            first[:1].upper() + first[1:],
            where=self.where,
            found=f"perhaps as a consequence: {found}",
            fix=" ".join(text for text in advice if text) or None,
            cause=cause,
        )
        lead.noticed = rest
        return lead


class UserCodeError(PlopError):
    """The user's own code is at fault: other runs of it will fail, too."""


class SignalTooWeakError(PlopError):
    """No amplitude of a hidden effect within its range moves the object as far as requested."""


@contextmanager
def remembering(warnings: Sequence[str]) -> Iterator[None]:
    """Attach the warnings collected so far to a PlopError that is raised inside.

    Args:
        warnings: List of warnings; read when the error is raised, so it may grow inside.
    """
    try:
        yield
    except PlopError as error:
        error.noticed = list(dict.fromkeys([*warnings, *error.noticed]))
        raise
