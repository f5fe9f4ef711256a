"""Errors that tell a person what is wrong and what to do next."""

from __future__ import annotations

from pathlib import Path


class PlopError(Exception):
    """Report one problem: where it is, what was expected, what was found, what to do.

    Args:
        problem: One sentence that names the problem.
        where: File, key, episode or camera that it concerns.
        expected: What a correct input would have.
        found: What is there instead.
        fix: What the user can do next.
    """

    def __init__(
        self,
        problem: str,
        *,
        where: str | Path | None = None,
        expected: str | None = None,
        found: str | None = None,
        fix: str | None = None,
    ) -> None:
        self.problem = problem
        self.where = None if where is None else str(where)
        self.expected = expected
        self.found = found
        self.fix = fix
        super().__init__(self.render())

    def render(self) -> str:
        """Lay the parts out as lines of text, leaving out what is unknown."""
        rows = [("where", self.where), ("expected", self.expected), ("found", self.found), ("fix", self.fix)]
        return "\n".join([self.problem, *(f"  {name}: {value}" for name, value in rows if value)])

    def as_dict(self) -> dict[str, str | None]:
        """Give the parts for `--json` output."""
        return {
            "problem": self.problem,
            "where": self.where,
            "expected": self.expected,
            "found": self.found,
            "fix": self.fix,
        }


class UserCodeError(PlopError):
    """The user's own code is at fault: no other run of it will do better."""
