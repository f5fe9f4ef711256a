"""Tables of the missing-physics benchmark, and of recordings of another simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from reference_pages import rows
from result_files import Table, law, percent, rate, read

NAMES = {
    ("single", "top1"): ("one hidden effect, at least twice the noise: named first", ">= 90 %"),
    ("single", "in_set"): ("the same: in the named set", ">= 95 %"),
    ("single", "all_amplitudes_top1"): ("one hidden effect of any amplitude: named first", ""),
    ("single", "wrong_name"): ("one hidden effect: a wrong name", ""),
    ("null", "false_alarm"): ("nothing hidden: something is named", "<= 2 %"),
    ("sensor", "called_physics"): ("only a sensor fault: called physics", "<= 5 %"),
    ("base", "named"): ("a changed base parameter: in the named set", ""),
    ("outside", "none_or_partly"): ("a law outside the library: NONE OF THESE or PARTLY", ">= 80 %"),
    ("pairs", "both_in_turn"): ("two hidden effects: both, one after the other", ">= 70 %"),
    ("pairs", "one"): ("two hidden effects: at least one", ">= 95 %"),
    ("decoys", "chosen"): ("decoys named, over all runs", "<= 2 %"),
    ("parameter_error", "covered"): ("95 % intervals that hold the hidden amplitude", "90 to 98 %"),
}
"""Rate of the missing-physics benchmark -> what it is, and its goal."""
MEDIANS = {
    "parameter_error": ("relative error of the amplitude, median", "<= 10 %"),
    "gap_closed": ("share of the explainable gap that is closed, median", ">= 80 %"),
    "wrong_law": ("the same for the best wrong law, median", "<= 20 %"),
}
OTHERS = {
    "bic_first": "forward selection by BIC: right effect first",
    "bic_null_false_alarm": "forward selection by BIC: names something where nothing is hidden",
    "sparse_first": "sparse regression: right effect first (it always names something)",
    "sindy_first": "PySINDy ensemble on accelerations: right term largest",
    "sindy_among": "PySINDy ensemble on accelerations: right term among those found",
    "sindy_null_false_alarm": "PySINDy ensemble on accelerations: names something where nothing is hidden",
}


def _overview() -> str:
    both = [read(name)["sets"] for name in ("physics_cameras", "physics_points")]
    lines: list[list[str]] = []
    for (group, key), (what, goal) in NAMES.items():
        lines.append([what, goal, *(rate(sets.get(group, {}).get(key)) for sets in both)])
    for key, (what, goal) in MEDIANS.items():
        lines.append([what, goal, *(f"{percent(s[key]['median'])} (n = {s[key]['n']})" for s in both)])
    return rows(["what", "goal", "through cameras", "on tracked points"], lines)


def _others() -> str:
    rates = read("physics_points")["sets"]["baselines"]
    return rows(
        ["other methods, same tracked points", "rate"], ([what, rate(rates[key])] for key, what in OTHERS.items())
    )


def _runs(name: str) -> Callable[[], str]:
    def made() -> str:
        lines = []
        for run in sorted(read(name)["runs"], key=lambda run: (run["set"], -run["snr"])):
            then = f", then {', '.join(run['next_named'])}" if run.get("next_named") else ""
            lines.append(
                [
                    f"{run['set']} {run['seed']}",
                    law(run["hidden"]) if run.get("rms_mm") is not None else ", ".join(run["hidden"]),
                    "-" if run.get("rms_mm") is None else f"{run['rms_mm']:.2f}",
                    f"{run['snr']:.1f}",
                    run["verdict"],
                    (", ".join(run["named"]) or "-") + then,
                    run.get("judged_by", "-"),
                ]
            )
        return rows(["run", "hidden", "moves [mm]", "SNR", "verdict", "named", "diagnose"], lines)

    return made


def _fresh() -> str:
    lines = []
    for run in read("fresh_recordings")["runs"]:
        before, after = run["fresh"]["before"], run["fresh"]["after"]
        lines.append(
            [
                run["seed"],
                ", ".join(run["hidden"]),
                ", ".join(run["named"]),
                f"{before['rms_mm']:.2f}",
                f"{after['rms_mm']:.2f}",
                f"{after['floor_mm']:.2f}",
                f"{after['persistence_mm']:.1f}",
                f"{after['rigid_mm']:.1f}",
            ]
        )
    head = ["seed", "hidden", "named", "base", "with the effect", "noise floor", "persistence", "rigid"]
    return rows(head, lines)


def _hidden(name: str) -> Callable[[], str]:
    def made() -> str:
        result = read(name)
        lines = []
        for found in result["sets"]:
            rms, gap = found["held_out_rms_mm"], None
            if found["verdict"] in ("EFFECT", "PARTLY"):
                gap = (found["error"] - found["left"]) / (found["error"] - found["floor"])
            after = f"{rms['after']:.2f}" if found["named"] else "-"
            answer = result["answers"][found["set"]] or "nothing"
            lines.append([found["set"], answer, *_named(found), percent(gap), f"{rms['before']:.2f}", after])
        return rows(["set", "changed", "verdict", "found", "of the gap", "before [mm]", "after [mm]"], lines)

    return made


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


def _hidden_cameras() -> str:
    lines = []
    for name, found in read("hidden_disect_cameras")["sets"]["engine"].items():
        gap = percent(found["closed_share"]) if found["verdict"] in ("EFFECT", "PARTLY") else ""
        after = f"{found['after_mm']:.2f}" if "after_mm" in found else "-"
        lines.append([name, *_named(found), gap, f"{found['before_mm']:.2f}", after])
    return rows(["set", "verdict", "found", "of the gap", "before [mm]", "after [mm]"], lines)


TABLES: dict[str, Table] = {
    "overview": (_overview, ("physics_cameras", "physics_points")),
    "other-methods": (_others, ("physics_points",)),
    "runs-cameras": (_runs("physics_cameras"), ("physics_cameras",)),
    "runs-points": (_runs("physics_points"), ("physics_points",)),
    "runs-learned": (_runs("physics-learned"), ("physics-learned",)),
    "runs-rough": (_runs("physics_rough"), ("physics_rough",)),
    "fresh": (_fresh, ("fresh_recordings",)),
    "hidden": (_hidden("hidden_disect"), ("hidden_disect",)),
    "hidden-learned": (_hidden("hidden_disect_learned"), ("hidden_disect_learned",)),
    "hidden-cameras": (_hidden_cameras, ("hidden_disect_cameras",)),
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""
