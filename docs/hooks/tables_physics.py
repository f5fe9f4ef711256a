"""Tables of the missing-physics benchmark, and of recordings of another simulator."""

from __future__ import annotations

from typing import Any

from markdown_parts import rows
from result_files import Table, percent, rate, read

FILES = tuple(f"missing_physics_{version}" for version in (73, "73_patterns", 70, "70_twelve", 69, 68, 67, 66, "0.2.0"))
"""By the version that verdicts now follow, then older ones; the last judged most sets."""
BENCH = FILES[-1]
SHAPED = tuple(f"missing_physics_{version}" for version in (68, 67, 66))
"""Shaped later versions: listed with all sets, without a column of rates."""
NAMES = {
    "null_false_alarm": "nothing hidden: an alarm",
    "dealt_false_alarm": "the same, episodes dealt out in other ways",
    "single_named_first": "one law, at least twice the noise: named first",
    "single_in_named_set": "the same: in the named set",
    "single_wrong_name": "the same: a wrong name",
    "base_parameter_named": "a changed stiffness or damping: named",
    "outside_none_or_partly": "a law outside the library: NONE OF THESE or PARTLY",
    "outside_wrong_name": "the same: a wrong name",
    "pairs_both": "two laws: both named",
    "sensor_called_physics": "only a sensor fault: called physics",
    "decoy_named": "decoys named, over all sets",
    "interval_coverage": "95 % intervals that hold the hidden amplitude",
    "base_interval_coverage": "95 % intervals of `identify` that hold the declared value",
}
MEDIANS = {
    "parameter_error": "relative error of the amplitude, median",
    "difference_closed": "share of the difference closed (misses as 0), median",
}
METHODS = {"bic": "forward selection by BIC", "sparse": "sparse regression", "correlation": "largest correlation"}


def _rates() -> str:
    """One column for the sets of each file, and one for those of the largest judged without a reference."""
    names = [name for name in FILES if name not in SHAPED]
    every, largest = [read(name) for name in names], read(BENCH)
    columns = {
        **{_judges(name, each): each["rates"] for name, each in zip(names, every, strict=True)},
        f"without reference, {_judges(BENCH, largest)}": largest["by_scenario"]["no reference"],
    }
    lines = [
        [what, every[0]["goals"].get(key, ""), *(_shown(c[key]) if key in c else "" for c in columns.values())]
        for key, what in NAMES.items()
    ]
    for key, what in MEDIANS.items():
        cells = [f"{percent(c[key]['median'])} (n = {c[key]['n']})" if c[key]["n"] else "" for c in columns.values()]
        lines.append([what, "", *cells])
    return rows(["what", "goal", *columns], lines)


def _judges(name: str, found: dict[str, Any]) -> str:
    how = "cameras, " if all(run["world"].endswith("cameras") for run in found["runs"]) else ""
    how += "a pattern for each set, " if name.endswith("patterns") else ""
    how += "twelve episodes a set, " if found.get("episodes") == [12] else ""
    return f"{how}by {' and '.join(map(str, found['judged_by']))}"


def _shown(found: dict[str, Any]) -> str:
    return rate(found) + (", **shown**" if found.get("shown") else "")


def _methods() -> str:
    found = read(BENCH)["rivals"]
    keys = ("single_named_first", "null_false_alarm")
    lines = [
        [what, *(f"{percent(found[method][key]['rate'])} (n = {found[method][key]['n']})" for key in keys)]
        for method, what in METHODS.items()
    ]
    return rows(
        ["other methods, the same evidence", "right law first", "names something where nothing is hidden"], lines
    )


def _sets() -> str:
    lines = [
        [
            f"{run['world']} {run['seed']}",
            run["judged_by"],
            run["group"],
            run["law"] or "-",
            "repeated" if run["repeated"] else "unlike",
            f"{run['snr']:.1f}",
            " ".join([verdict["kind"], ", ".join(verdict["named"])]).strip(),
        ]
        for name in FILES
        for run in read(name)["runs"]
        for verdict in [run["said"]["reference"]["verdict"]]
    ]
    return rows(["base", "by", "set", "hidden", "motions", "SNR", "verdict"], lines)


def _hidden() -> str:
    lines = [
        [*(found[key] for key in ("set", "answer", "left_out", "reference", "diagnose_version")), *_named(found)]
        for found in read("hidden_disect_cameras")["sets"]
    ]
    return rows(["set", "changed", "left out", "reference", "version", "verdict", "found"], lines)


def _named(found: dict[str, Any]) -> list[str]:
    """Return the verdict with what it names, and the amplitudes with their intervals."""
    amounts = [
        f"{key} {each['value']:.2g} ({each['low']:.2g} to {each['high']:.2g}) {each['unit'].replace('-', '')}".strip()
        for law in found["ranking"]
        if law["effect"] in found["named"]
        for key, each in law["parameters"].items()
        if each["low"] is not None
    ]
    return [" ".join([found["verdict"], ", ".join(found["named"])]).strip(), "; ".join(amounts)]


TABLES: dict[str, Table] = {
    "rates": (_rates, FILES),
    "methods": (_methods, (BENCH,)),
    "sets": (_sets, FILES),
    "hidden": (_hidden, ("hidden_disect_cameras",)),
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""
