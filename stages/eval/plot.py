"""Draw scores over time, prediction and baselines together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from plop.reporting.colours import PERSISTENCE, PREDICTION
from plop.reporting.field_pictures import save
from plop.uncertainty.errors import PointErrors
from plop.uncertainty.scores import BandScores

TITLES = {
    "cd_mm": "CD [mm]",
    "emd_mm": "EMD [mm]",
    "hd_mm": "HD [mm]",
    "psnr_db": "PSNR [dB]",
    "ssim": "SSIM [-]",
    "j_score": "J [-]",
}
_STYLES = (("tab:blue", "-", 3), ("tab:gray", "--", 2), ("tab:orange", ":", 1)) + tuple(
    (colour, "-.", 0) for colour in ("tab:green", "tab:red", "tab:purple", "tab:brown")
)


def plot_over_time(path: Path, rows: list[dict[str, Any]], environment: str) -> None:
    """Draw one panel per score and one line per method and episode, over the time since frame 0.

    Args:
        path: PNG to write.
        rows: One row per episode, method and frame.
        environment: Title.
    """
    figure = Figure(figsize=(11, 6), layout="constrained")
    methods = list(dict.fromkeys(row["method"] for row in rows))
    episodes = list(dict.fromkeys(row["episode"] for row in rows))
    for panel, (metric, title) in zip(figure.subplots(2, 3).flat, TITLES.items(), strict=True):
        for method, (colour, dash, order) in zip(methods, _STYLES, strict=False):
            for place, episode in enumerate(episodes):
                mine = [row for row in rows if (row["method"], row["episode"]) == (method, episode)]
                points = [(row["time_s"] - mine[0]["time_s"], row[metric]) for row in mine if row[metric] is not None]
                if points:
                    style = {"color": colour, "linestyle": dash, "zorder": 2 + order, "linewidth": 1.5}
                    panel.plot(*zip(*points, strict=True), label=method if place == 0 else None, **style)
        panel.set(title=title, xlabel="time since frame 0 [s]")
        panel.grid(alpha=0.3)
    figure.axes[0].legend()
    figure.suptitle(f"{environment}: {len(episodes)} episode(s), one line each")
    save(figure, path)


MOST_EPISODES = 12
"""Episodes in the picture of bands, those with the smallest coverage."""


def plot_bands(path: Path, errors: Sequence[PointErrors], scores: BandScores) -> None:
    """Draw the band's mean radius over time, before and after widening, against the measured errors, by episode."""
    coverage = {name: each["widened"]["coverage"] for name, each in scores.episodes.items()}
    shown = sorted(errors, key=lambda each: coverage[each.name])[:MOST_EPISODES]
    columns = min(4, len(shown))
    lines = -(-len(shown) // columns)
    figure = Figure(figsize=(3.2 * columns + 1.2, 2.6 * lines + 0.8), layout="constrained")
    for panel, each in zip(figure.subplots(lines, columns, squeeze=False).flat, shown, strict=False):
        far = np.where(each.counts, 1000 * np.linalg.norm(each.error_m, axis=-1), np.nan)
        frames = each.counts.any(1)
        time = (each.time_s - each.time_s[0])[frames]
        radius = 1000 * np.where(each.counts, scores.band.radius_m(each.spread_m), np.nan)
        mean = np.nanmean(radius[frames], axis=1)
        panel.fill_between(time, 0, mean, color=PREDICTION, alpha=0.2, linewidth=0, label="90 % band")
        panel.plot(time, mean / scores.band.factor, color=PREDICTION, linestyle="--", label="before widening")
        panel.plot(time, np.nanquantile(far[frames], 0.9, axis=1), color="black", label="90 % of the points are nearer")
        panel.plot(time, np.nanmedian(far[frames], axis=1), color=PERSISTENCE, label="half of the points are nearer")
        panel.set_title(f"{each.name}: {coverage[each.name]:.0%} inside", fontsize=9)
        panel.set(xlabel="time [s]", ylabel="mm")
        panel.set_ylim(bottom=0)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=columns, frameon=False)
    which = f"; the {len(shown)} with the smallest coverage" if len(shown) < len(errors) else ""
    figure.suptitle(f"measured error and band, {len(errors)} test episode(s){which}", fontsize=10)
    save(figure, path)
