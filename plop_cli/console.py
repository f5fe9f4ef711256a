"""The only module that prints: results to stdout, progress and errors to stderr."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from plop.errors import PlopError
from plop.finite import UNKNOWN

if TYPE_CHECKING:
    from plop.pipeline.mapping import Progress

LONGEST_UNBROKEN = 18
"""Table cells up to this length are never wrapped, even on narrow terminals."""

LINE_EVERY_S = 15.0
"""Interval between progress lines without a terminal."""
PACE_PIECES, PACE_S, PACE_SHARE = 2.0, 5.0, 0.1
"""Number of pieces, or else time [s] and finished share of the batch, needed to estimate the speed."""


class Console:
    """Output of one command, according to its options."""

    def __init__(self, *, quiet: bool = False, as_json: bool = False) -> None:
        self.quiet = quiet or as_json
        self.as_json = as_json

    def say(self, text: str) -> None:
        """Print one line of the result, unless quiet."""
        if not self.quiet:
            _rich(stderr=False).print(text, markup=False, highlight=False, soft_wrap=True)

    def note(self, text: str) -> None:
        """Print one line beside the result, unless quiet."""
        if not self.quiet:
            _rich(stderr=True).print(text, markup=False, highlight=False, soft_wrap=True, style="dim")

    def at_once(self, text: str) -> None:
        """Print one line beside the result before anything heavy is imported, unless quiet."""
        if not self.quiet:
            sys.stderr.write(f"{text}\n")
            sys.stderr.flush()

    def warn(self, text: str) -> None:
        """Print a warning to stderr, also when quiet."""
        _rich(stderr=True).print(f"warning: {text}", markup=False, highlight=False, soft_wrap=True, style="yellow")

    def result(self, facts: Any) -> None:
        """Print the machine-readable result, if requested."""
        if self.as_json:
            sys.stdout.write(json.dumps(facts, indent=1, default=str) + "\n")

    def table(self, rows: list[dict[str, Any]], title: str | None = None, *, unbroken: str = "") -> None:
        """Print rows of equal keys as a table, unless quiet; cells of the column `unbroken` are not wrapped."""
        if self.quiet or not rows:
            return
        from rich.table import Table

        table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
        keys = [key for key in rows[0] if any(row.get(key) not in (None, "") for row in rows)]
        for key in keys:
            numeric = all(isinstance(row.get(key), (int, float)) for row in rows)
            longest = max(len(_cell(row.get(key))) for row in rows)
            heading = str(key).replace("_", "\n") if longest < len(str(key)) else str(key)
            whole = key == unbroken or longest <= LONGEST_UNBROKEN
            table.add_column(heading, justify="right" if numeric else "left", overflow="fold", no_wrap=whole)
        for row in rows:
            table.add_row(*[_cell(row.get(key)) for key in keys])
        _rich(stderr=False).print(table, highlight=False)

    def error(self, error: PlopError) -> None:
        """Print an error to stderr: as text or as JSON."""
        if self.as_json:
            sys.stderr.write(json.dumps({"error": error.as_dict()}, indent=1) + "\n")
            return
        first, *rest = error.render().splitlines()
        console = _rich(stderr=True)
        console.print(f"error: {first}", markup=False, highlight=False, soft_wrap=True, style="bold red")
        for line in rest:
            console.print(line, markup=False, highlight=False, soft_wrap=True)

    @contextmanager
    def progress(self, title: str) -> Iterator[Progress]:
        """Show the progress of long work: a bar on a terminal, lines at intervals elsewhere."""
        if self.quiet:
            yield _ignore
        elif sys.stderr.isatty():
            with _bar(title) as report:
                yield report
        else:
            yield _Lines(self, title)


def _ignore(done: float, total: float, label: str = "", **figures: Any) -> None:
    return


def _rich(*, stderr: bool) -> Any:
    from rich.console import Console as RichConsole

    return RichConsole(stderr=stderr)


def _cell(value: Any) -> str:
    from rich.markup import escape

    return escape(format_figure(value))


def format_figure(value: Any) -> str:
    """Format a number with four significant digits, anything else unchanged."""
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else UNKNOWN
    return str(value)


def format_seconds(seconds: float) -> str:
    """Format a duration: 0.4 s, 12 s, 3 min 20 s, 2 h 05 min."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


@contextmanager
def _bar(title: str) -> Iterator[Progress]:
    from rich import progress as rp

    columns = (
        rp.TextColumn("{task.description}"),
        rp.BarColumn(bar_width=24),
        rp.TaskProgressColumn(),
        rp.TextColumn("{task.fields[rate]}"),
        rp.TextColumn("{task.fields[left]}"),
        rp.TextColumn("{task.fields[figures]}"),
    )
    with rp.Progress(*columns, console=_rich(stderr=True), transient=True) as bar:
        task, pace = bar.add_task(title, total=None, rate="", left="", figures=""), _Pace()

        def report(done: float, total: float, label: str = "", **figures: Any) -> None:
            speed = pace.per_s(done, total, time.monotonic())
            bar.update(
                task,
                completed=done,
                total=total,
                description=f"{title} {label}".strip(),
                rate=f"{speed:.3g}/s" if speed else "",
                left=_left(done, total, speed),
                figures=_join(figures),
            )

        yield report


def _join(figures: dict[str, Any]) -> str:
    return "  ".join(f"{key} {format_figure(value)}" for key, value in figures.items())


class _Pace:
    """Speed of a batch, measured from its first report.

    Earlier work and the first piece are excluded, because kernels are compiled and processes start there.
    """

    def __init__(self) -> None:
        self._total, self._last, self._first, self._since = 0.0, 0.0, 0.0, 0.0

    def per_s(self, done: float, total: float, now_s: float) -> float | None:
        """Record a report, and return the pace [1/s]; None while too little is done for an estimate."""
        if total != self._total or done < self._last or done == self._first:  # another batch, or not started
            self._total, self._first, self._since = total, done, now_s
        self._last = done
        ahead, seconds = done - self._first, now_s - self._since
        known = ahead >= PACE_PIECES or (ahead >= PACE_SHARE * total and seconds >= PACE_S)
        return ahead / seconds if known and seconds > 0 else None


def _left(done: float, total: float, per_s: float | None) -> str:
    return "" if per_s is None else f"{format_seconds((total - done) / per_s)} left"


class _Lines:
    """Progress without a terminal: one line every LINE_EVERY_S."""

    def __init__(self, console: Console, title: str) -> None:
        self.console, self.title, self.pace = console, title, _Pace()
        self.last = time.monotonic()

    def __call__(self, done: float, total: float, label: str = "", **figures: Any) -> None:
        now = time.monotonic()
        left = _left(done, total, self.pace.per_s(done, total, now))
        if now - self.last < LINE_EVERY_S or not total:
            return
        self.last = now
        share = f"{100 * done / total:.0f} %"
        parts = [f"{self.title} {label}".strip(), f"{share}, {left}" if left else share, _join(figures)]
        self.console.note("  ".join(part for part in parts if part))
