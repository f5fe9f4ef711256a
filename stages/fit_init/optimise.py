"""Fit Gaussians to views of one frame: 3D Gaussian splatting with densification, pruning and filling."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from plop.gaussians.split import split_at
from plop.gaussians.state import Gaussians, concatenate
from plop.render.losses import Target, anisotropy_hinge, render_loss
from plop.render.rasterizer.rasterize import render
from stages.fit_init.parameters import Parameters

if TYPE_CHECKING:
    from stages.fit_init.stage import FitInitConfig

_DISPLACEMENT = 0.7
"""Displacement of the halves of a split Gaussian, in its standard deviations."""
Fill = Callable[[Gaussians], Gaussians]
"""Function that makes the inner Gaussians of a shell."""
Report = Callable[[int, dict[str, float]], None]
"""Called with the step and its figures."""


def fit(
    seeds: Gaussians,
    targets: list[Target],
    config: FitInitConfig,
    *,
    spacing_m: float,
    max_count: int,
    fill: Fill | None = None,
    report: Report | None = None,
) -> tuple[Gaussians, Gaussians]:
    """Optimise the shell, one view per step; the inside is made once, and then only rendered, or optimised as well.

    Args:
        seeds: Gaussians to start from.
        targets: Measured views; at least one.
        config: Steps, rates, weights, seed.
        spacing_m: Spacing of the seeds, the unit of the means' learning rate and of the limits on scales [m].
        max_count: Largest number of Gaussians of the shell.
        fill: Makes the inner Gaussians from the shell at `config.fill_at`; none when absent.
        report: Called every 20th step.

    Returns:
        The shell and the inner Gaussians, without gradients.

    Source: PLOP, Eq. 8-10 and Sec. III-C.
    """
    generator = torch.Generator("cpu").manual_seed(config.seed)
    parameters = Parameters(seeds, config, spacing_m)
    inner = seeds.select(seeds.ids.new_zeros(0))
    inside = seeds.ids.new_zeros(len(parameters), dtype=torch.bool)
    growth, fill_step = _growth_steps(config), int(config.fill_at * config.steps)
    pull, order = seeds.means.new_zeros(len(parameters)), torch.zeros(0, dtype=torch.int64, device="cpu")
    for step in range(config.steps):
        if step == fill_step and fill is not None:
            inner = fill(parameters.gaussians().detach().to("cpu")).to(seeds.means.device)
            if config.optimise_inside and len(inner):
                parameters.append(inner)
                inside = torch.cat([inside, torch.ones_like(inner.ids, dtype=torch.bool)])
                pull = torch.cat([pull, pull.new_zeros(len(inner))])
                inner = inner.select(inner.ids.new_zeros(0))
        if step in growth:
            inside = inside[_grow_and_prune(parameters, pull, max_count, len(growth) - growth.index(step), config)]
            pull = seeds.means.new_zeros(len(parameters))
        if len(order) == 0:
            order = torch.randperm(len(targets), generator=generator, device="cpu")
        target = targets[int(order[0])]
        order = order[1:]
        shell = parameters.gaussians()
        rendering = render(concatenate([shell, inner]) if len(inner) else shell, target.camera)
        loss, terms = render_loss(rendering, target, config.render)
        loss = loss + config.anisotropy_weight * anisotropy_hinge(shell, config.anisotropy_ratio)
        loss.backward()
        pull += parameters.pull()
        parameters.step(step / config.steps)
        if report is not None and (step % 20 == 19 or step + 1 == config.steps):
            report(step + 1, {"loss": float(loss.detach()), "l1": float(terms["l1"])})
    fitted = parameters.gaussians().detach()
    return (fitted.select(~inside), fitted.select(inside)) if inside.any() else (fitted, inner)


def _growth_steps(config: FitInitConfig) -> list[int]:
    """Return the steps at which the shell grows and is pruned: spread over the first half."""
    if config.densifications <= 0:
        return []
    interval = 0.5 * config.steps / (config.densifications + 1)
    return sorted({int(interval * (round_ + 1)) for round_ in range(config.densifications)})


def _grow_and_prune(
    parameters: Parameters, pull: Tensor, max_count: int, rounds_left: int, config: FitInitConfig
) -> Tensor:
    """Remove invisible Gaussians and split those with the largest gradients of their means.

    Returns:
        The row, among those before, that each descends from, int64.
    """
    shell = parameters.gaussians().detach()
    parents = torch.nonzero(shell.opacities > config.prune_opacity).squeeze(1)
    if len(parents) == 0:
        return torch.arange(len(shell), device=parents.device)
    room = max(max_count - len(parents), 0) // rounds_left
    # A large Gaussian with a large gradient covers more detail than one Gaussian can represent.
    size = shell.scales.prod(1).pow(1 / 3)
    split_rows = (pull * size)[parents].argsort(descending=True, stable=True)[:room]
    grown, origin = split_at(shell.select(parents), split_rows, pull.new_full((len(split_rows),), _DISPLACEMENT))
    parameters.replace(grown, parents[origin])
    return parents[origin]
