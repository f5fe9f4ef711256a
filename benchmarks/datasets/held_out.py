"""How well Gaussians fitted to five views show the sixth: `python -m benchmarks.datasets.held_out --data DISECT`.

Renders the first frame of part recordings 004 and 005 of the nine environments, fits them with the defaults of
`plop fit-init`, with and without virtual views, and merges the scores into docs/results/held_out.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from joblib import Parallel, delayed

from benchmarks.facts import machine
from plop.artifacts.atomic_file import write_json
from plop.recordings.readers.disect.episode import read_disect
from plop.recordings.readers.mesh.resample import resampled
from plop.recordings.recording import Recording
from plop.render.virtual_cameras.recorder import record
from plop.render.virtual_cameras.settings import CameraSettings
from stages.fit_init.episode import fit_episode
from stages.fit_init.stage import FitInitConfig

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "held_out.json"
ENVIRONMENTS = [
    f"{shape}_{stuff}" for shape in ("cylinder", "prism", "sphere") for stuff in ("foam", "jelly", "polymer")
]
PARTS = ("part_004", "part_005")
KEPT = ("psnr_db", "psnr_black_db", "depth_error_mm", "coverage", "held_out")


def held_out_score(data: Path, episode: str, config: FitInitConfig) -> dict[str, Any]:
    """Render an episode's first frame, fit it, and score the view that was held out of the fit."""
    torch.set_num_threads(1)
    sequence = read_disect(data / f"{episode}.usd")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{episode}.h5"
        for _ in record(path, resampled(sequence, sequence.times[:2]), CameraSettings()):
            pass
        with Recording(path) as recording:
            started = time.perf_counter()
            score = fit_episode(recording, None, None, config, lambda step, figures: None).score
    return {key: score[key] for key in KEPT} | {"seconds": round(time.perf_counter() - started, 1)}


def means(episodes: dict[str, dict[str, dict[str, Any]]]) -> dict[str, dict[str, dict[str, float]]]:
    """Average PSNR and depth error over the episodes of each environment, and over environments ("mean").

    Returns:
        {environment: {setting: {"psnr_db", "depth_error_mm"}}}.
    """
    named: dict[str, list[dict[str, dict[str, Any]]]] = {}
    for episode, scores in sorted(episodes.items()):
        named.setdefault(episode.rsplit("_part", 1)[0].replace("_", "-"), []).append(scores)
    found = {name: _mean(rows) for name, rows in named.items()}
    return {**found, "mean": _mean(list(found.values()))}


def _mean(rows: list[dict[str, dict[str, Any]]]) -> dict[str, dict[str, float]]:
    return {
        setting: {key: float(np.mean([row[setting][key] for row in rows])) for key in ("psnr_db", "depth_error_mm")}
        for setting in rows[0]
    }


def main() -> None:
    """Fit, print one line per fit, and write the result file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="Folder with the DiSECt recordings.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("environments", nargs="*", default=ENVIRONMENTS)
    options = parser.parse_args()
    default = FitInitConfig()
    settings = {count: replace(default, virtual_views=count) for count in (0, default.virtual_views)}
    wanted = [(f"{name}_{part}", count) for name in options.environments for part in PARTS for count in settings]
    scores = Parallel(n_jobs=options.jobs)(
        delayed(held_out_score)(options.data, episode, settings[count]) for episode, count in wanted
    )
    found = json.loads(RESULT.read_text())["episodes"] if RESULT.is_file() else {}
    names = {count: f"virtual_views {count}" for count in settings}
    found = {
        episode: {name: given[name] for name in given if name in names.values()} for episode, given in found.items()
    }
    for (episode, count), score in zip(wanted, scores, strict=True):
        found.setdefault(episode, {})[names[count]] = score
        sys.stdout.write(f"{episode} {count}: {score['psnr_db']:.2f} dB, {score['depth_error_mm']:.2f} mm\n")
    facts = {
        "command": "python -m benchmarks.datasets.held_out --data <DiSECt folder>",
        "machine": machine(),
        "seeds": [default.seed],
        "steps": default.steps,
        "environments": means(found),
        "episodes": dict(sorted(found.items())),
    }
    write_json(RESULT, facts, sort_keys=False)


if __name__ == "__main__":
    main()
