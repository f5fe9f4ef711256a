"""Speed and fidelity of fit-init: `python -m benchmarks fit_init`, and by hand over real recordings.

By hand: `python -m benchmarks.bench_fit_init RECORDINGS... [--clouds FOLDER...] [--rope FOLDER] [--set NAME=VALUE]
--out FOLDER` fits the first episode of every recording set, writes the artifacts to FOLDER and prints one row each.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np


def cases() -> dict[str, Callable[[], float]]:
    """Give each figure's name and the function that measures it."""
    return {"fit_init_6_views_128_3k_2000_steps_s": fit_s, "render_loss_128_fwd_bwd_ms": loss_ms}


def fit_s() -> float:
    """One episode: 6 views of 128 x 128 px, 3,000 Gaussians, from 200 steps timed and scaled to 2,000."""
    from benchmarks.recorded_block import recorded_block
    from plop.recordings.recording import Recording
    from plop.render.rasterize import render
    from stages.fit_init.episode import fit_object, usable_views
    from stages.fit_init.shell import surface_from_views
    from stages.fit_init.stage import FitInitConfig

    with recorded_block() as path, Recording(path) as recording:
        views, table = usable_views(recording, []), recording.table_z_m
    config = FitInitConfig(steps=200)
    surface = surface_from_views(views)
    shell, _ = fit_object(surface, views, table, replace(config, steps=10))  # compiles
    render(shell, views[0].camera)
    started = time.perf_counter()
    fit_object(surface, views, table, replace(config, steps=0))
    fixed = time.perf_counter() - started
    started = time.perf_counter()
    fit_object(surface, views, table, config)
    stepping = time.perf_counter() - started - fixed
    return fixed + 10 * stepping


def loss_ms() -> float:
    """The rendering loss of one 128 x 128 view with an object of about 80 x 80 px, and its gradient."""
    import torch

    from benchmarks.measure import median_ms
    from plop.render.interface import Rendering
    from plop.render.losses import Target, render_loss

    generator = torch.Generator().manual_seed(0)
    mask = torch.zeros(128, 128, dtype=torch.bool)
    mask[24:104, 24:104] = True
    rgb = torch.rand(128, 128, 3, generator=generator) * mask[..., None]
    target = Target(rgb, 0.3 * mask, mask, torch.ones_like(mask))
    image = (0.9 * rgb).requires_grad_()
    alpha = (0.98 * mask).requires_grad_()

    def work() -> None:
        render_loss(Rendering(image, 0.31 * mask, alpha), target)[0].backward()

    return median_ms(work, repeats=31)


def main() -> int:
    """Fit the first episode of each recording set."""
    from plop.pipeline.settings import resolve
    from plop.pipeline.stage import Input, Output
    from stages.fit_init.stage import STAGE

    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_fit_init", description=__doc__)
    parser.add_argument("recordings", nargs="*", type=Path, help="payloads of ingest or calibrate")
    parser.add_argument("--clouds", nargs="*", type=Path, default=[], help="payloads of fuse, in the same order")
    parser.add_argument("--rope", type=Path, help="folder of gs-dynamics' demo")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting of fit-init")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    settings = {name: json.loads(value) for name, value in (pair.split("=", 1) for pair in options.set)}
    if options.rope:
        _say(rope(options.rope, settings))
    for index, folder in enumerate(options.recordings):
        first = json.loads((folder / "episodes.json").read_text())["train"][0]
        inputs = {"recordings": Input(folder)}
        if options.clouds:
            inputs["clouds"] = Input(options.clouds[index])
        out = options.out / folder.name
        out.mkdir(parents=True, exist_ok=True)
        started, used = time.perf_counter(), time.process_time()
        STAGE.run(inputs, resolve(STAGE.config, "fit-init", ("--set", {"episodes": first, **settings})), Output(out))
        score = json.loads((out / first / "fit.json").read_text())
        keys = ("gaussians", "inner", "held_out", "psnr_db", "psnr_black_db", "depth_error_mm", "coverage")
        seconds = {"wall_s": round(time.perf_counter() - started, 1), "cpu_s": round(time.process_time() - used, 1)}
        _say({"episode": first, **{key: score[key] for key in keys}, **seconds})
    return 0


def rope(folder: Path, settings: dict[str, object]) -> dict[str, object]:
    """Fit the photographs of the rope: all four, then each one scored by a fit to the other three."""
    from benchmarks.rope import rope_surface, rope_views
    from plop.pipeline.settings import resolve
    from stages.fit_init.episode import fit_object
    from stages.fit_init.held_out import score_view
    from stages.fit_init.stage import FitInitConfig

    config = resolve(FitInitConfig, "fit-init", ("--set", {"filling": "none", "render.depth": 0.0, **settings}))
    views, surface = rope_views(folder), rope_surface(folder)
    shell, _ = fit_object(surface, views, None, config)
    fitted = [score_view(shell, view)[0].psnr_db for view in views]
    held = []
    for view in views:
        shell, _ = fit_object(surface, [other for other in views if other is not view], None, config)
        held.append(score_view(shell, view)[0].psnr_db)
    return {
        "rope_fitted_psnr_db": round(float(np.mean(fitted)), 2),
        "rope_held_out_psnr_db": round(float(np.mean(held)), 2),
    }


def _say(row: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(row) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
