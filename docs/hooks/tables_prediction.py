"""Tables of predictions: networks and engine on the nine DiSECt environments, and the band around predictions."""

from __future__ import annotations

from statistics import mean
from typing import Any

from markdown_parts import rows
from result_files import Table, read


def _gains(part: str = "") -> str:
    from plop.metrics.table import gains_to_markdown

    return gains_to_markdown(read("disect")[part] if part else read("disect"))


def _scores(part: str) -> str:
    from plop.metrics.table import to_markdown

    return to_markdown(read("disect"), part=part)


MODELS = {
    "network, recordings alone": "disect-cpu-recordings",
    "network, with simulated episodes": "disect",
    "engine alone": "disect-engine",
}


def _models() -> str:
    """Compare the means over environments of networks and engine."""
    names = {"cd_mm": "CD [mm]", "emd_mm": "EMD [mm]", "truth_rms_mm": "nodes [mm]", "psnr_db": "PSNR [dB]"}
    lines = []
    for model, source in MODELS.items():
        methods = [each["plop"] for each in read(source)["environments"].values()]
        cells = []
        for key in names:
            digits = 1 if key == "psnr_db" else 2
            pair = [mean(part[key]["mean"] for part in parts) for parts in (methods, [m["end"] for m in methods])]
            cells.append(", ".join(f"{value:.{digits}f}" for value in pair))
        lines.append([model, *cells])
    return rows(["model", *(f"{title}: whole, end" for title in names.values())], lines)


def _halves() -> str:
    environments = read("cut_halves")["environments"].values()
    keys = {"cd_mm": "CD [mm]", "emd_mm": "EMD [mm]", "nodes_mm": "nodes [mm]"}
    lines = []
    for variant in next(iter(environments)):
        each = [environment[variant] for environment in environments]
        cells = [f"{mean(one[part][key] for one in each):.2f}" for part in ("episode", "end") for key in keys]
        lines.append([variant, *cells, f"{mean(one['ms'] for one in each):.0f}"])
    head = [f"{title}, {part}" for part in ("whole", "end") for title in keys.values()]
    return rows(["rollout with", *head, "ms a frame"], lines)


def _engine_disect() -> str:
    lines = []
    for environment in read("engine_disect")["environments"].values():
        scores = environment["scores"]
        for episode, fitted in scores["calibrated_7.15mm"].items():
            stated = scores["stated_7.15mm"][episode]["rms_end_mm"]
            lines.append(
                [
                    episode,
                    f"{fitted['motion_rms_mm']:.1f}",
                    f"{stated:.2f}",
                    f"{fitted['rms_end_mm']:.2f}",
                    f"{scores['calibrated_5mm'][episode]['rms_end_mm']:.2f}",
                    environment["points_on_wrong_side"][episode],
                ]
            )
    head = ["test recording", "motion", "as stated", "fitted", "fitted, 5 mm particles", "points beyond the blade"]
    return rows(head, lines)


ABLATED = {"cd_mm": 3, "emd_mm": 3, "ssim": 3, "psnr_db": 2, "j": 3}
"""Metric -> its digits."""
ABLATED_HEAD = ["CD [mm]", "EMD [mm]", "SSIM", "PSNR [dB]", "J"]


def _ablation() -> str:
    """Show the means of each variant over seeds, with persistence in the last line of an environment."""
    grouped: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in read("ablation")["rows"]:
        grouped.setdefault((row["environment"], row["targets"], "on" if row["resampling"] else "off"), []).append(row)
    lines = []
    for environment in dict.fromkeys(key[0] for key in grouped):
        own = {key: found for key, found in grouped.items() if key[0] == environment}
        for key, found in own.items():
            counts = [f"{mean(row[name] for row in found):.0f}" for name in ("splits", "merges")]
            scores = [f"{mean(row[name] for row in found):.{n}f}" for name, n in ABLATED.items()]
            lines.append([*key, len(found), *counts, *scores])
        still = next(iter(own.values()))[0]["persistence"]
        lines.append([environment, "persistence", *[""] * 4, *(f"{still[key]:.{n}f}" for key, n in ABLATED.items())])
    return rows(["environment", "targets", "resampling", "seeds", "splits", "merges", *ABLATED_HEAD], lines)


def _interval(found: dict[str, float], digits: int, unit: float = 1) -> str:
    mean, low, high = (f"{unit * found[key]:.{digits}f}" for key in ("mean", "low", "high"))
    return f"{mean} [{low}, {high}]"


def _ablation_changes() -> str:
    """Show paired differences with their intervals."""
    lines = []
    for row in read("ablation")["effects"]:
        what = f"{row['targets']}, {'on' if row['resampling'] else 'off'}, less {row['than']}"
        lines.append([what, row["n"], *(_interval(row[key], n) for key, n in ABLATED.items())])
    return rows(["targets, resampling", "pairs", *ABLATED_HEAD], lines)


BANDS = {
    "ensemble": "spread of three seeds, as it is",
    "widened": "the band: spread times the factor",
    "constant": "the same prediction, one radius everywhere",
    "persistence": "nothing moves, one radius everywhere",
}


def _bands() -> str:
    lines = []
    for method, name in BANDS.items():
        scores = read("bands")["methods"][method]
        inside = [_interval(scores[key], 0, 100) for key in ("coverage", "coverage_end")]
        lines.append([name, *inside, *(_interval(scores[key], 2) for key in ("nees", "crps_mm", "radius_mm"))])
    return rows(["radius", "inside [%]", "inside at the end [%]", "NEES", "CRPS [mm]", "mean radius [mm]"], lines)


def _dealt_again() -> str:
    lines = []
    for deal in read("bands")["dealt_again"]:
        share = {key: f"{100 * value:.0f} %" for key, value in deal["coverage"].items()}
        promised = "90 %" if deal["guaranteed"] else "nothing"
        lines.append([deal["validation"], promised, share["mean"], f"{share['low']} to {share['high']}"])
    return rows(["validation episodes", "guaranteed", "inside, mean", "in 9 of 10 deals"], lines)


DISECT, EACH = ("disect",), ("disect-cpu-recordings", "disect", "disect-engine")
TABLES: dict[str, Table] = {
    "gains": (_gains, DISECT),
    "gains-plain": (lambda: _gains("plain"), DISECT),
    "scores": (lambda: _scores("episode"), DISECT),
    "scores-end": (lambda: _scores("end"), DISECT),
    "models": (_models, EACH),
    "halves": (_halves, ("cut_halves",)),
    "ablation": (_ablation, ("ablation",)),
    "ablation-changes": (_ablation_changes, ("ablation",)),
    "engine-disect": (_engine_disect, ("engine_disect",)),
    "bands": (_bands, ("bands",)),
    "bands-dealt": (_dealt_again, ("bands",)),
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""
