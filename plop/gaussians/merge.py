"""Merge Gaussians of low weight into their nearest surviving neighbour (PLOP, Eq. 27)."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from plop.gaussians.covariance import scales_quats_from_covariance
from plop.gaussians.state import Gaussians
from plop.geometry.clouds.neighbours import nearest_index

MergeForm = Literal["moments", "paper"]
MAX_OPACITY = 0.999
"""Largest opacity: a Gaussian is never fully opaque."""
_MIN_WEIGHT = 1e-8


def merge(gaussians: Gaussians, below: float, *, form: MergeForm = "moments") -> tuple[Gaussians, Tensor]:
    """Remove Gaussians with opacity under `below`, each one absorbed by the nearest that stays.

    Any number may merge into one survivor; the result is that of merging them one after
    the other. With opacities as weights both forms keep the mean of survivor and
    absorbed; `moments` also keeps their covariance, adding the spread of the means that
    Eq. 27 leaves out, and averages their colours. `paper` is Eq. 27, and the survivor
    keeps its colour. Opacities add up, to less than 1: beyond it, as Eq. 27 allows,
    nothing could be rendered.
    A survivor that absorbs nothing keeps its numbers and its gradients untouched. If no
    Gaussian would survive, all stay.

    Args:
        gaussians: N Gaussians.
        below: Opacity threshold tau_m; a Gaussian at the threshold stays.
        form: Which equations.

    Returns:
        M <= N Gaussians with the survivors' ids, and the input row each descends from,
        shape [M], int64. Gradients reach means, opacities, scales and colours of all.

    Source: PLOP, Sec. III-F.1; the covariance term is the law of total covariance.
    """
    low = gaussians.opacities.detach() < below
    keep = torch.nonzero(~low).squeeze(1)
    drop = torch.nonzero(low).squeeze(1)
    if len(drop) == 0 or len(keep) == 0:
        return gaussians, torch.arange(len(gaussians), device=gaussians.means.device)
    nearest = nearest_index(gaussians.means[drop], gaussians.means[keep])
    survivors = gaussians.select(keep)
    changed, group = nearest.unique(return_inverse=True)
    members = torch.cat([keep[changed], drop])
    group = torch.cat([torch.arange(len(changed), device=group.device), group])
    merged = _join(gaussians.select(members), group, len(changed), form)
    return _replace_rows(survivors, changed, merged), keep


def _join(members: Gaussians, group: Tensor, count: int, form: MergeForm) -> dict[str, Tensor]:
    """Merge the members of each group; the survivors are the first `count` rows."""
    weight = members.opacities.clamp_min(_MIN_WEIGHT)
    mass = weight.new_zeros(count).index_add(0, group, weight)
    share = weight / mass[group]

    def average(values: Tensor) -> Tensor:
        scaled = values * share.reshape(-1, *[1] * (values.ndim - 1))
        return values.new_zeros(count, *values.shape[1:]).index_add(0, group, scaled)

    means = average(members.means)
    covariances = members.covariances
    if form == "moments":
        offset = members.means - means[group]
        covariances = covariances + offset[:, :, None] * offset[:, None, :]
    scales, quats = scales_quats_from_covariance(average(covariances))
    return {
        "means": means,
        "quats": quats,
        "scales": scales,
        "opacities": mass.clamp_max(MAX_OPACITY),
        "sh": average(members.sh) if form == "moments" else members.sh[:count],
    }


def _replace_rows(gaussians: Gaussians, rows: Tensor, values: dict[str, Tensor]) -> Gaussians:
    """Replace some rows, without affecting the gradients of the others."""
    return gaussians.with_(**{name: getattr(gaussians, name).index_copy(0, rows, new) for name, new in values.items()})
