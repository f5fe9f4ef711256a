"""Speed and fidelity of fit-init: `python -m benchmarks.speed fit_init`, and by hand over real recordings.

By hand: `python -m benchmarks.speed.fit_init RECORDINGS... [--clouds FOLDER...] [--rope FOLDER] [--set NAME=VALUE]
--out FOLDER` fits the first episode of every recording set, writes the artifacts to FOLDER and prints one row each.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {"fit_init_6_views_128_3k_2000_steps_s": fit_s, "render_loss_128_fwd_bwd_ms": loss_ms}


def fit_s() -> float:
    """One episode: 6 views of 128 x 128 px, 3,000 Gaussians, from 200 steps timed and scaled to 2,000."""
    from benchmarks.speed.block import recorded_block
    from plop.recordings.recording import Recording
    from plop.render.rasterizer.rasterize import render
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

    from benchmarks.speed.measure import median_ms
    from benchmarks.speed.raster import camera
    from plop.render.losses import Target, render_loss
    from plop.render.rasterizer.interface import Rendering

    generator = torch.Generator().manual_seed(0)
    mask = torch.zeros(128, 128, dtype=torch.bool)
    mask[24:104, 24:104] = True
    rgb = torch.rand(128, 128, 3, generator=generator) * mask[..., None]
    target = Target(camera(128, 0), rgb, 0.3 * mask, mask, torch.ones_like(mask))
    image = (0.9 * rgb).requires_grad_()
    alpha = (0.98 * mask).requires_grad_()

    def work() -> None:
        render_loss(Rendering(image, 0.31 * mask, alpha), target)[0].backward()

    return median_ms(work, repeats=31)
