"""Speed of the learned dynamics and of the command line: `python -m benchmarks.speed dynamics`."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import torch

from benchmarks.speed.measure import median_ms, median_ratio
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.interface import ToolStep, at_rest
from plop.dynamics.particle_grid.grid import fit_grid
from plop.dynamics.particle_grid.kernels import build_stencil
from plop.dynamics.particle_grid.transfer import g2p, p2g
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.tool import ToolGeometry
from plop.physics.scenes.tools import blade_mesh

_CHANNELS = 32
_SIZE_M = (0.08, 0.05, 0.04)


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {
        "i2n_forward_300_ms": lambda: median_ms(i2n_forward(300), repeats=31),
        "i2n_forward_10000_ms": lambda: median_ms(i2n_forward(10_000), repeats=31),
        "i2n_forward_10000_over_300": lambda: median_ratio(i2n_forward(10_000), i2n_forward(300)),
        "i2n_step_300_ms": lambda: median_ms(i2n_step(300), repeats=31),
        "i2n_step_10000_ms": lambda: median_ms(i2n_step(10_000), repeats=31),
        "i2n_step_10000_over_300": lambda: median_ratio(i2n_step(10_000), i2n_step(300)),
        "p2g_10000_ms": lambda: transfer_ms(gather=False),
        "g2p_10000_ms": lambda: transfer_ms(gather=True),
        "plop_help_s": help_s,
    }


def i2n_step(count: int) -> Callable[[], object]:
    """One step of the model without gradients, merging and splitting left out; the object keeps its size."""
    torch.manual_seed(0)
    model, state, action = PlopModel(PlopConfig()).eval(), at_rest(_block(count)), _action()

    def work() -> None:
        with torch.no_grad():
            model.predict([state], [action])

    return work


def i2n_forward(count: int) -> Callable[[], object]:
    """The network alone in that step: features to the grid, convolutions, back to the particles."""
    torch.manual_seed(0)
    model, state, action = PlopModel(PlopConfig()).eval(), at_rest(_block(count)), _action()
    taken: list[tuple[object, ...]] = []
    hook = model.network.register_forward_pre_hook(lambda _, arguments: taken.append(arguments))
    with torch.no_grad():
        model.predict([state], [action])
    hook.remove()

    def work() -> None:
        with torch.no_grad():
            model.network(*taken[0])

    return work


def transfer_ms(*, gather: bool) -> float:
    """One transfer of 32 channels between 10,000 particles and a grid of 16 nodes along the object."""
    points = _block(10_000).means
    box = fit_grid(points, torch.zeros(len(points), dtype=torch.long), 1, _SIZE_M[0] / 12, stride=1)
    stencil = build_stencil(points - box.origin, box.spacing_m, box.shape, "quadratic")
    values = torch.randn(len(points), _CHANNELS)
    features = p2g(values, stencil)[0]
    return median_ms((lambda: g2p(features, stencil)) if gather else (lambda: p2g(values, stencil)), repeats=31)


def help_s() -> float:
    """`plop --help` as a whole process."""
    return (
        median_ms(
            lambda: subprocess.run([sys.executable, "-m", "plop_cli", "--help"], check=True, stdout=subprocess.DEVNULL),
            repeats=7,
        )
        / 1000
    )


def _block(count: int) -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    means = torch.rand(count, 3, generator=generator) * torch.tensor(_SIZE_M)
    quats = torch.nn.functional.normalize(torch.randn(count, 4, generator=generator), dim=-1)
    scales, opacities = torch.full((count, 3), 0.002), torch.full((count,), 0.9)
    return Gaussians(means, quats, scales, opacities, torch.zeros(count, 1, 3), torch.arange(count))


def _action() -> ToolStep:
    before, after = torch.eye(4), torch.eye(4)
    before[:3, 3] = torch.tensor([0.04, 0.025, 0.02])
    after[:3, 3] = torch.tensor([0.042, 0.025, 0.018])
    return ToolStep(ToolGeometry.from_mesh(*blade_mesh()), before, after, 0.04, 0.0)
