"""The same runs judged by two versions, or diagnosed by two engines, side by side."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.missing_physics.row import Group, Row
from plop.parameters import short_number


def compared(before: Iterable[Row], after: Iterable[Row]) -> str:
    """Give a line for each run and hidden law of the second result that the first holds, too."""
    earlier = {row.name: row for row in before}
    lines = ["| run | hidden | before | found | since | found |", "|---|---|---|---|---|---|"]
    for row in after:
        if row.set is Group.UNREACHABLE or row.name not in earlier:
            continue
        pair = (earlier[row.name], row)
        for law, values in row.hidden.items() or (("", {}),):
            hidden = ", ".join([law, *(f"{name} {short_number(value)}" for name, value in values.items())])
            cells = [cell for each in pair for cell in (_verdict(each), _found(each, law))]
            lines.append(f"| {' | '.join([f'{row.set} {row.seed}', hidden or '-', *cells])} |")
    return "\n".join(lines)


def _found(row: Row, law: str) -> str:
    """Write what was fitted: amplitudes with their intervals, shapes as they were chosen.

    Where the file does not keep them: how far the amplitude is off, and how well the law's response points.
    """
    if row.parameters is None:
        off, response = row.amplitude_off, row.response
        known = [
            f"{100 * off:.0f} % off" if off is not None else "",
            f"cosine {response['cosine']:.2f}" if response else "",
        ]
        return ", ".join(filter(None, known)) or "-"
    cells = [
        f"{short_number(p['value'])} ({short_number(p['low'])} to {short_number(p['high'])})"
        if p["low"] is not None and p["high"] is not None and not p.get("chosen")
        else f"{name} {short_number(p['value'])}"
        for name, p in row.parameters.get(law, {}).items()
    ]
    return ", ".join(cells) or "-"


def _verdict(row: Row) -> str:
    """Write what was named, what was named in the next round, and which share of the gap a law closes.

    A base parameter's is not given: the gap counts from where the base's stiffness is refitted.
    """
    then = f", then {', '.join(row.next_named)}" if row.next_named else ""
    closed = row.gap_closed() if row.named and row.verdict != "BASE PARAMETER" else None
    share = "" if closed is None else f" ({100 * min(closed, 1):.0f} %)"
    return f"{row.verdict} {', '.join(row.named)}{then}{share}".strip()
