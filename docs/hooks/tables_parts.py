"""Tables of speed, and of the accuracy of single parts."""

from __future__ import annotations

from statistics import mean, median
from typing import Any

from markdown_parts import rows
from result_files import Table, law, rate, read


def _speed() -> str:
    from benchmarks.speed.goals import GOALS

    cases, lines = read("bench")["cases"], []
    for name, goal in GOALS.items():
        figure = cases[name] * goal.scale
        reached = figure <= goal.value if goal.sign == "<=" else figure >= goal.value
        lines.append(
            [
                goal.what,
                f"{float(f'{figure:.3g}'):g}{goal.unit}",
                f"{goal.sign} {goal.value:g}{goal.unit}",
                "yes" if reached else "**no**",
            ]
        )
    return rows(["what", "measured", "goal", "reached"], lines)


def _diagnose_time() -> str:
    lines = [
        [
            each["what"],
            each["laws"],
            each["engine_runs"],
            f"{each['seconds'] / 60:.1f}",
            each["goal_min"] or "-",
            " ".join([each["verdict"], *each["named"]]),
        ]
        for each in read("diagnose_time")["diagnoses"]
    ]
    return rows(["diagnosis", "laws", "engine runs", "time [min]", "goal [min]", "verdict"], lines)


def _waiting() -> str:
    def cell(way: dict[str, Any], size: int) -> str:
        return ", ".join(f"{way[f'{state}_{size}_ms']['median']:.0f}" for state in ("quiet", "busy"))

    lines = [[name, *(cell(way, size) for size in (300, 3000, 10000))] for name, way in read("waiting")["ways"].items()]
    return rows(["threads", "300 particles: idle, busy", "3,000", "10,000"], lines)


def _held_out() -> str:
    by: dict[str, list[dict[str, Any]]] = {}
    for name, episode in read("held_out")["episodes"].items():
        by.setdefault(name.rsplit("_part", 1)[0].replace("_", "-"), []).append(episode)
    ways = ("virtual_views 0", "virtual_views 32")
    lines = []
    for name, episodes in by.items():
        cells = [
            f"{mean(e[way][key] for e in episodes):.{d}f}"
            for key, d in (("psnr_db", 1), ("depth_error_mm", 2))
            for way in ways
        ]
        lines.append([name, *cells])
    head = ["PSNR [dB] without", "with", "depth error [mm] without", "with"]
    return rows(["environment", *head], lines)


def _sensors() -> str:
    names = {
        "right_set_accused": "all right: any camera or the tool accused",
        "right_camera_accused": "a right camera, also of rigs with faults: accused",
        "tool_accused_without_fault": "a right tool: accused",
        "right_camera_not_judged": "a right camera: cannot be judged",
        "clock_found": "clock of one camera, 30 ms: found",
        "depth_scale_found": "depth scale of one camera, 1 %: found",
        "pose_shift_found": "shift of one camera, 3 mm: found",
        "pose_turn_found": "turn of one camera, 1 deg: found",
        "robot_clock_found": "clock of the robot, 30 ms: found",
        "tool_offset_found": "tool shifted in the hand, 3 mm: found",
        "tool_thickness_found": "tool thicker than its mesh, 3 mm a side: found",
    }
    rates = read("sensor_faults")["rates"]
    return rows(["what", "rate (95 % interval)"], [[text, rate(rates[name])] for name, text in names.items()])


def _depth_checks() -> str:
    lines = [
        [row["set"], row["recordings"], row["named"], row["cameras"], row["unusable"], row["verdicts"].get("good", 0)]
        for row in read("depth_checks")["rows"]
        if "recordings" in row
    ]
    return rows(["fault of all cameras", "recordings", "named", "cameras", "unusable", 'still "good"'], lines)


def _known_laws() -> str:
    lines = [
        [law({each["law"]: each["values"]}), *(f"{each[key]:.2f}" for key in ("without_mm", "with_mm", "factor"))]
        for each in read("known_laws")["laws"]
    ]
    return rows(["law", "without it [mm]", "with it [mm]", "best factor of its response"], lines)


def _identified() -> str:
    def error_mm(found: dict[str, Any]) -> str:
        return f"{max(found['rms_mm'] ** 2 - found['noise_mm'] ** 2, 0) ** 0.5:.2f} of {found['moved_mm']:.1f}"

    lines = []
    for each in read("identified")["rows"]:
        declared, found = each["declared"], {name: e["value"] for name, e in each["estimates"].items()}
        ratio = found["youngs_modulus_pa"] / declared["youngs_modulus_pa"]
        rubs = [f"{found[name]:.2f} ({declared[name]:.2f})" for name in ("table_friction", "tool_friction")]
        errors = [error_mm(each[part]) for part in ("fitted", "unseen")]
        mesh, force = f"{1000 * each['cells_m']:.1f}", each["forces"]
        pushes = [f"{force['press_ratio']:.2f}", f"{force['engine_drag_share']:.2f} ({force['drag_share']:.2f})"]
        lines.append(
            [each["world"], each["seed"], mesh, *errors, f"{ratio:.2f}", *rubs, *pushes, round(each["seconds"])]
        )
    head = [
        "mesh [mm]",
        "error, fitted motions [mm]",
        "unseen motions [mm]",
        "stiffness over declared",
        "table friction",
        "tool friction",
        "force of a press over the world's",
        "lateral share of a drag's force",
    ]
    return rows(["world", "seed", *head, "time [s]"], lines)


def _discretisations() -> str:
    lines = [
        [motion, *(f"{found[key]:.2f}" for key in ("alone_mm", "mean_mm", "spread_mm", "correlation"))]
        for motion, found in read("discretisations")["predictions"].items()
    ]
    return rows(
        ["motion", "one run [mm]", "mean of three [mm]", "spread [mm]", "correlation of spread and error"], lines
    )


def _survey() -> str:
    by: dict[str, dict[str, list[float]]] = {}
    worlds = read("survey")["worlds"].values()
    for name, found in ((name, row) for world in worlds for name, row in world.items()):
        for key, values in found.items():
            by.setdefault(name, {}).setdefault(key, []).extend(values)

    def cell(values: list[float]) -> str:
        return f"{median(values):.2f} ({min(values):.2f} to {max(values):.2f})"

    lines = [
        [f"`{name}`", len(row["size"]), f"{median(row['moves_mm']):.2f}", cell(row["cosine"]), cell(row["size"])]
        for name, row in sorted(by.items())
    ]
    return rows(["law", "n", "moves by [mm]", "cosine of the two responses", "size, of that with 1,300"], lines)


def _effects() -> str:
    lines = [
        [
            f"`{name}`",
            f"{found['step_mm']:.3f}",
            f"{found['typical_mm']:.2f}",
            f"{100 * found['curved']:.0f} %",
            f"{100 * found['cost']:+.0f} %",
        ]
        for name, found in read("effects")["effects"].items()
    ]
    return rows(
        ["effect", "moves at its step [mm]", "at its typical amplitude [mm]", "nonlinearity", "cost of a time step"],
        lines,
    )


def _cuts() -> str:
    keys = {
        "force_n": "force while cutting [N]",
        "lift_mm": "lift when drawn out [mm]",
        "gap_mm": "gap afterwards [mm]",
        "moved_mm": "moves by [mm]",
    }
    lines = []
    for motion, found in read("cohesive_motions")["motions"].items():
        for name, changes in found["changed"].items():
            cells = ["" if changes[0].get(k) is None else f"{mean(one[k] for one in changes):+.2f}" for k in keys]
            lines.append([f"`{motion}`", name, *cells])
    return rows(["motion", "law", *keys.values()], lines)


def _paper_step() -> str:
    lines = []
    for device, facts in read("paper_step").items():
        if not isinstance(facts, dict):
            continue
        for count, found in facts["gaussians"].items():
            parts = ("without_images", "whole")
            cells = [f"{found[p][key]:{form}}" for p in parts for key, form in (("step_s", ".2f"), ("peak_mb", ".0f"))]
            lines.append([device, count, *cells, f"{found['whole']['splits']:.0f}, {found['whole']['merges']:.0f}"])
    head = ["without images [s]", "[MB]", "whole [s]", "[MB]", "splits, merges a frame"]
    return rows(["device", "Gaussians", *head], lines)


TABLES: dict[str, Table] = {
    "speed": (_speed, ("bench",)),
    "diagnose-time": (_diagnose_time, ("diagnose_time",)),
    "waiting": (_waiting, ("waiting",)),
    "held-out": (_held_out, ("held_out",)),
    "sensors": (_sensors, ("sensor_faults",)),
    "depth-checks": (_depth_checks, ("depth_checks",)),
    "known-laws": (_known_laws, ("known_laws",)),
    "identified": (_identified, ("identified",)),
    "survey": (_survey, ("survey",)),
    "discretisations": (_discretisations, ("discretisations",)),
    "effects": (_effects, ("effects",)),
    "cuts": (_cuts, ("cohesive_motions",)),
    "paper-step": (_paper_step, ("paper_step",)),
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""
