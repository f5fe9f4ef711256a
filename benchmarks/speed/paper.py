"""A training step of profile `paper`, its time and memory: `python -m benchmarks.speed.paper --device cuda`.

One step is the paper's: a whole episode (10 frames, 6 views of 128 x 128 px) from its fitted Gaussians, every view of
every frame rendered, forward, backward and optimiser, with merging and splitting. Without a renderer for the device
the step is measured without images, and the result says so.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from benchmarks.facts import machine
from benchmarks.speed.block import FRAMES, recorded_block
from benchmarks.speed.measure import median_ms
from plop.artifacts.atomic_file import write_json
from plop.compute.device import chosen_device
from plop.dynamics.i2n.model import PlopModel
from plop.errors import PlopError
from plop.gaussians.splat_ply import write_splat
from plop.pipeline.chain import read_profile
from plop.pipeline.execute import versions
from plop.pipeline.settings import resolve
from plop.recordings.recording import Recording
from stages.fit_init.episode import fit_object, usable_views
from stages.fit_init.shell import surface_from_views
from stages.fit_init.stage import FitInitConfig
from stages.train.form import model_config
from stages.train.objective import TrainingStep
from stages.train.settings import TrainConfig
from stages.train.tracks import Track, load_track, write_start
from stages.train.windows import whole_episodes

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "paper_step.json"


def start_of(recording_path: Path, count: int, device: torch.device) -> Track:
    """Fit the block's first frame with about `count` Gaussians, on the CPU; return the episode's start on a device."""
    folder = recording_path.parent
    with Recording(recording_path) as recording:
        views, table = usable_views(recording, []), recording.table_z_m
    fit = FitInitConfig(steps=10, count=count, filling="none", flatness=1.0, anisotropy_ratio=2.5, device="cpu")
    fitted, _ = fit_object(surface_from_views(views), views, table, fit)
    write_splat(folder / f"{count}.ply", fitted)
    write_start(folder / f"{count}.ply", folder / f"{count}.h5")
    return load_track("block", recording_path, folder / f"{count}.h5", device)


def step_of(track: Track, config: TrainConfig, device: torch.device) -> Callable[[], dict[str, float]]:
    """Return a function that takes one optimisation step and returns its log."""
    torch.manual_seed(0)
    model = PlopModel(model_config(config, [track])).to(device)
    optimiser = torch.optim.AdamW(model.parameters(), lr=config.learning_rate)
    step_loss = TrainingStep(model)
    windows = whole_episodes([FRAMES - 1], 1, config.horizon, config.views, seed=0, step=0)

    def work() -> dict[str, float]:
        optimiser.zero_grad()
        loss, log = step_loss(windows, [track], config.weights, config.render, config.noise_m, config.views)
        loss.backward()
        optimiser.step()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        return log

    return work


def measured(work: Callable[[], dict[str, float]], device: torch.device, repeats: int) -> dict[str, float]:
    """Return the time of a step [s], its largest memory [MB] (on the CPU that of the process), and what it did."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
    seconds = median_ms(work, repeats=repeats, warm_up=2) / 1000
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    if device.type == "cuda":
        peak = torch.cuda.max_memory_allocated(device)
    log = work()
    kept = {key: round(log[key], 3) for key in ("gaussians", "splits", "merges")}
    return {"step_s": round(seconds, 4), "peak_mb": round(peak / 2**20, 1), **kept}


def main() -> int:
    """Measure each size, and write the result after it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed.paper", description=__doc__)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--gaussians", nargs="+", type=int, default=[1000, 3000, 5000])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    device = chosen_device(options.device)
    config = resolve(TrainConfig, "train", ("profile paper", read_profile("paper").settings["train"]))
    blind = replace(config, weights=replace(config.weights, image=0.0))
    kept = json.loads(options.out.read_text()) if options.out.is_file() else {}
    rows: dict[str, dict[str, Any]] = {}
    with recorded_block() as recording_path:
        for count in options.gaussians:
            track = start_of(recording_path, count, device)
            row: dict[str, Any] = {"without_images": measured(step_of(track, blind, device), device, options.repeats)}
            try:
                row["whole"] = measured(step_of(track, config, device), device, options.repeats)
            except PlopError as error:
                row["whole"] = {"unavailable": error.problem}
            rows[str(count)] = row
            sys.stdout.write(f"{device} {count:6d} Gaussians: {row}\n")
            sys.stdout.flush()
            facts = {"machine": machine(), "versions": versions(), "frames": FRAMES - 1, "gaussians": rows}
            write_json(options.out, {**kept, device.type: facts})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
