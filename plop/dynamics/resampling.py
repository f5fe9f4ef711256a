"""Resampling: merge Gaussians of low opacity, split long ones (PLOP, Sec. III-F)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import torch
from torch import Tensor

from plop.dynamics.interface import ParticleState, Resampling
from plop.gaussians.merge import merge
from plop.gaussians.split import split
from plop.setting_kinds import Formerly, Range, Settings, Share, Unit


@dataclass(frozen=True)
class ResamplingConfig(Settings):
    """When Gaussians merge and split; the defaults are defined only here."""

    enabled: Annotated[bool, Formerly("resample")] = True
    """Merge and split; off, the set of Gaussians never changes (the comparison in docs/explanation/deviations.md)."""
    merge_below: Share = 0.05
    """Opacity threshold tau_m under which a Gaussian merges into its nearest survivor."""
    merge_share: Share = 0.0
    """Share of the fitted Gaussians fainter than tau_m, from which `train` measures it; 0 uses `merge_below`."""
    split_above: Annotated[float, Range(1)] = 20.0
    """Ratio tau_s of longest to shortest axis above which a Gaussian splits; `fit-init` makes them up to 12."""
    split_share: Share = 0.0
    """Share of the fitted Gaussians that is more elongated than tau_s, from which `train` measures it; 0 uses
    `split_above`."""
    form: Literal["moments", "paper"] = "moments"
    """"moments" keeps mass, mean and covariance; "paper" is Eq. 27-28."""
    max_count: Annotated[int, Range(1), Unit("Gaussians")] = 20000
    """Largest number of Gaussians after splitting."""


def resample(
    state: ParticleState, config: ResamplingConfig, *, generator: torch.Generator | None = None
) -> ParticleState:
    """Apply R^m, then R^s; motion, side and rest position follow the lineage.

    Args:
        state: Predicted state with updated opacities.
        config: Thresholds.
        generator: Draws the displacement of the splits.

    Returns:
        The resampled state, with what was done in `resampling`; the same object when nothing merges or splits.
    """
    if not config.enabled:
        return state
    merged, kept = merge(state.gaussians, config.merge_below, form=config.form)
    divided, parents = split(
        merged, config.split_above, form=config.form, generator=generator, max_count=config.max_count
    )
    merges, splits = len(state.gaussians) - len(kept), len(parents) - len(kept)
    if merges == splits == 0:
        return state
    shift = divided.means.detach() - merged.means.detach()[parents]
    parents = kept[parents]
    rest = None if state.rest is None else state.rest.select(parents).moved(shift)
    return replace(state.select(parents), gaussians=divided, rest=rest, resampling=Resampling(parents, merges, splits))


def effective_sample_size(opacities: Tensor) -> Tensor:
    """Count the Gaussians that matter: (sum w)^2 / sum w^2 of the opacities, in [1, N]."""
    return opacities.sum().square() / opacities.square().sum().clamp_min(1e-12)
