"""The same runs diagnosed by two engines, side by side."""

from __future__ import annotations

from typing import Any


def compared(first: list[dict[str, Any]], second: list[dict[str, Any]]) -> str:
    """Give a table with a line for each run that the second engine diagnosed; the first may not have.

    Args:
        first: Runs as results/<name>.json keeps them.
        second: The same of the other engine.
    """
    ours = {row["name"]: row for row in first}
    lines = ["| run | hidden | SNR | with the coarser engine: verdict, share of the gap | with the finer "
             "| amplitude off by [%] | cosine of its response [-] |", "|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in sorted(second, key=lambda row: (row["set"], -row["snr"])):
        if row["set"] != "unreachable":
            pair = [ours.get(row["name"]), row]
            cells = [f"{row['set']} {row['seed']}", ", ".join(row["hidden"]) or "-", f"{row['snr']:.1f}",
                     *map(_verdict, pair), _both([_off(each) for each in pair]),
                     _both([_cosine(each) for each in pair])]  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _verdict(row: dict[str, Any] | None) -> str:
    """Write what was named, what was named in the next round, and which share of the gap a law closes.

    A base parameter's is not given: the gap counts from where the base's stiffness is refitted.
    """
    if row is None:
        return "not run"
    then = f", then {', '.join(row['next_named'])}" if row.get("next_named") else ""
    gap = row["error"] - (row["floor"] or row["error"])
    told = row["named"] and row["left"] and gap > 0 and row["verdict"] != "BASE PARAMETER"
    share = f" ({100 * min((row['error'] - row['left']) / gap, 1):.0f} %)" if told else ""
    return f"{row['verdict']} {', '.join(row['named'])}{then}{share}".strip()


def _off(row: dict[str, Any] | None) -> str:
    found = None if row is None else row.get("amplitude_off")
    return "-" if found is None else f"{100 * found:.0f}"


def _cosine(row: dict[str, Any] | None) -> str:
    found = None if row is None else row.get("response")
    return "-" if not found else f"{found['cosine']:.2f}"


def _both(cells: list[str]) -> str:
    return "-" if cells == ["-", "-"] else " -> ".join(cells)
