"""The same runs diagnosed by two engines, or judged by two versions, side by side.

`python -m benchmarks.physics_compared BEFORE.json AFTER.json` prints the runs that both results hold, with what was
hidden and the amplitudes that were found.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from plop.parameters import short_number


def judged_again(before: list[dict[str, Any]], after: list[dict[str, Any]]) -> str:
    """Give a table with a line for each run and hidden law of the second result that the first holds, too.

    Args:
        before: Runs as results/<name>.json keeps them.
        after: The same, judged again.
    """
    earlier = {row["name"]: row for row in before}
    lines = ["| run | hidden | before | found | since | found |", "|---|---|---|---|---|---|"]
    for row in after:
        if row["set"] == "unreachable" or row["name"] not in earlier:
            continue
        pair = (earlier[row["name"]], row)
        for law, values in row["hidden"].items() or (("", {}),):
            hidden = ", ".join([law, *(f"{name} {short_number(value)}" for name, value in values.items())])
            cells = [cell for each in pair for cell in (_verdict(each), _found(each, law))]
            lines.append(f"| {' | '.join([row['set'] + ' ' + str(row['seed']), hidden or '-', *cells])} |")
    return "\n".join(lines)


def _found(row: dict[str, Any], law: str) -> str:
    """Write what was fitted: amplitudes with their intervals, shapes as they were chosen.

    Where the file does not keep them: how far the amplitude is off, and how well the law's response points.
    """
    if "parameters" not in row:
        off, response = row.get("amplitude_off"), row.get("response")
        told = [
            f"{100 * off:.0f} % off" if off is not None else "",
            f"cosine {response['cosine']:.2f}" if response else "",
        ]
        return ", ".join(filter(None, told)) or "-"
    fitted = row["parameters"].get(law, {})
    cells = [
        f"{short_number(p['value'])} ({short_number(p['low'])} to {short_number(p['high'])})"
        if p["low"] is not None and p["high"] is not None and not p.get("chosen")
        else f"{name} {short_number(p['value'])}"
        for name, p in fitted.items()
    ]
    return ", ".join(cells) or "-"


def _verdict(row: dict[str, Any]) -> str:
    """Write what was named, what was named in the next round, and which share of the gap a law closes.

    A base parameter's is not given: the gap counts from where the base's stiffness is refitted.
    """
    then = f", then {', '.join(row['next_named'])}" if row.get("next_named") else ""
    gap = row["error"] - (row["floor"] or row["error"])
    told = row["named"] and row["left"] and gap > 0 and row["verdict"] != "BASE PARAMETER"
    share = f" ({100 * min((row['error'] - row['left']) / gap, 1):.0f} %)" if told else ""
    return f"{row['verdict']} {', '.join(row['named'])}{then}{share}".strip()


def main() -> None:
    """Print the table of two result files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    options = parser.parse_args()
    before, after = (json.loads(path.read_text())["runs"] for path in (options.before, options.after))
    sys.stdout.write(judged_again(before, after) + "\n")


if __name__ == "__main__":
    main()
