"""Split elongated Gaussians in two along their longest axis (PLOP, Eq. 28); the halves lie inside the parent."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from plop.gaussians.merge import MAX_OPACITY
from plop.gaussians.state import Gaussians, concatenate
from plop.geometry.rigid import quat_to_matrix

SplitForm = Literal["moments", "paper"]
DISPLACEMENT_RANGE = (0.6, 0.9)
"""Displacement in standard deviations that `moments` draws: near 0 gives two copies, near 1 two flat discs."""


def split(
    gaussians: Gaussians,
    ratio_above: float,
    *,
    form: SplitForm = "moments",
    generator: torch.Generator | None = None,
    max_count: int | None = None,
    opacity_above: float = 0.0,
) -> tuple[Gaussians, Tensor]:
    """Split every Gaussian whose longest scale is more than `ratio_above` times its shortest.

    `moments` moves the two halves by +-v s_max e_max, v in `DISPLACEMENT_RANGE`, and
    shrinks only the variance along e_max, by (1 - v^2). The pair has exactly the mean
    and the covariance of the parent, and opacities chosen so that the integral of
    opacity over space (hence over any ray bundle) stays, up to the limit below 1.

    `paper` is Eq. 28: +-v e_max with v uniform in [-1, 1], the whole covariance times
    (1 - v^2), half the opacity each. v counts standard deviations of the parent along
    e_max, as 1 - v^2 implies: the variance along e_max stays, and the halves' centres
    lie inside the parent. Counted in units of the scene, as printed, the centres would
    lie up to the size of the object away.

    Args:
        gaussians: N Gaussians.
        ratio_above: Threshold tau_s of longest over shortest scale [-].
        form: Which equations.
        generator: Draws v; torch's global generator when absent.
        max_count: Most Gaussians in the result; the most elongated are split first.
        opacity_above: Only Gaussians with at least this opacity are split.

    Returns:
        M >= N Gaussians: the input rows in their order, where a split one holds its first
        half, then the second halves; and the input row each descends from, shape [M],
        int64. Ids are the parents'. Gradients reach all fields.

    Source: PLOP, Sec. III-F.2.
    """
    count = len(gaussians)
    with torch.no_grad():
        ratio = gaussians.scales.amax(1) / gaussians.scales.amin(1).clamp_min(1e-12)
        chosen = torch.nonzero((ratio > ratio_above) & (gaussians.opacities >= opacity_above)).squeeze(1)
        if max_count is not None and len(chosen) > max(max_count - count, 0):
            order = ratio[chosen].argsort(descending=True, stable=True)
            chosen = chosen[order[: max(max_count - count, 0)]].sort().values
    return split_at(gaussians, chosen, _draw(len(chosen), form, gaussians.means, generator), form=form)


def split_at(
    gaussians: Gaussians, rows: Tensor, displacement: Tensor, *, form: SplitForm = "moments"
) -> tuple[Gaussians, Tensor]:
    """Split the given Gaussians; see `split`.

    Args:
        gaussians: N Gaussians.
        rows: Which ones, each once, shape [K], int64.
        displacement: v of Eq. 28, shape [K].
        form: Which equations.

    Returns:
        N + K Gaussians and the input row each descends from, in the order of `split`.
    """
    everyone = torch.arange(len(gaussians), device=gaussians.means.device)
    if len(rows) == 0:
        return gaussians, everyone
    first, second = _halves(gaussians.select(rows), displacement, form)
    names = ("means", "scales", "opacities")
    kept = gaussians.with_(**{n: getattr(gaussians, n).index_copy(0, rows, getattr(first, n)) for n in names})
    return concatenate([kept, second]), torch.cat([everyone, rows])


def _draw(count: int, form: SplitForm, like: Tensor, generator: torch.Generator | None) -> Tensor:
    low, high = DISPLACEMENT_RANGE if form == "moments" else (-1.0, 1.0)
    device = like.device if generator is None else generator.device
    uniform = torch.rand(count, generator=generator, device=device).to(like)
    return low + (high - low) * uniform


def _halves(parents: Gaussians, v: Tensor, form: SplitForm) -> tuple[Gaussians, Gaussians]:
    """Make both halves of each parent from its displacement v, shape [N]."""
    rows = torch.arange(len(parents), device=v.device)
    longest = parents.scales.detach().argmax(1)
    axis = quat_to_matrix(parents.quats)[rows, :, longest]
    shrink = (1 - v.square()).clamp_min(1e-6).sqrt()
    offset = (v * parents.scales[rows, longest])[:, None] * axis
    if form == "moments":
        along = torch.nn.functional.one_hot(longest, 3).to(v)
        scales = parents.scales * (1 - along * (1 - shrink)[:, None])
        opacities = (parents.opacities / (2 * shrink)).clamp_max(MAX_OPACITY)
    else:
        scales = parents.scales * shrink[:, None]
        opacities = parents.opacities / 2
    halves = parents.with_(scales=scales, opacities=opacities)
    return halves.with_(means=parents.means + offset), halves.with_(means=parents.means - offset)
