"""Draw scores over time, prediction and baselines together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from plop.artifacts.atomic_file import whole

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
    with whole(path) as scratch:
        figure.savefig(scratch, format="png", dpi=110, metadata={"Software": None})
