"""What PySINDy makes of the tracked accelerations: the baseline that the field would try first.

Accelerations of the patches, measured minus predicted by the base, are regressed on terms that can be computed from the
tracks alone: sparse regression with sequential thresholds, bagged over the samples (Fasel et al., Proc. R. Soc. A 478,
2022). A term stands for the effects that would add it to the equation of motion. What an effect does at places that no
track shows (toughness, say) has no term. Needs the extra `bench`.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from plop.tracking.episode import Episode

MODELS, INCLUDED = 40, 0.6
"""Models of the ensemble, and the share of them in which a term must appear to be named."""
THRESHOLD = 0.1
"""Coefficients of normalised terms below this share of the largest are dropped."""
_NEIGHBOURS, _NEAR_TABLE_M, _NEAR_TOOL_M = 6, 0.012, 0.012
_RELAXATION_S, _WINDOW = 0.1, 7
STANDS_FOR: Mapping[str, tuple[str, ...]] = {
    "velocity": ("damping", "drag"),
    "laplacian of displacement": ("stiffness", "softening"),
    "laplacian of displacement, cubic": ("stiffening",),
    "laplacian of displacement along x": ("fibres",),
    "laplacian of faded displacement": ("relaxation", "plasticity"),
    "laplacian of velocity": ("viscosity",),
    "x": ("tilt",),
    "y": ("tilt",),
    "growth": ("swelling",),
    "sliding on the table": ("table_friction",),
    "towards the tool": ("adhesion",),
    "sliding along the tool": ("blade_friction",),
    "acceleration of the base": ("inertia",),
}


def sindy_ranking(episodes: Sequence[Episode], predictions: Sequence[np.ndarray], *, seed: int = 0) -> list[list[str]]:
    """Rank terms by their size, those left out that less than INCLUDED of the models hold.

    Args:
        episodes: What was measured.
        predictions: Of the base, the followed points, [T, M, 3] [m] each.
        seed: Draws the ensemble.

    Returns:
        The effects that each term stands for, the largest term first.
    """
    import pysindy

    parts = [_samples(episode, points) for episode, points in zip(episodes, predictions, strict=True)]
    terms, target = np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])[:, None]
    spread = np.maximum(terms.std(0), 1e-12)
    terms, target = terms / spread, target / target.std()
    largest = np.abs(np.linalg.lstsq(terms, target, rcond=None)[0]).max()
    np.random.seed(seed)
    optimizer = pysindy.EnsembleOptimizer(
        pysindy.STLSQ(threshold=THRESHOLD * float(largest), alpha=1e-3), bagging=True, n_models=MODELS
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optimizer.fit(terms, target)
    coefficients = np.stack(optimizer.coef_list)[:, 0]
    held = (np.abs(coefficients) > 0).mean(0)
    size = np.where(held >= INCLUDED, np.abs(np.median(coefficients, 0)), 0)
    names = list(STANDS_FOR)
    return [list(STANDS_FOR[names[k]]) for k in np.argsort(-size) if size[k] > 0]


def _samples(episode: Episode, prediction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Terms [S, C] and residual accelerations [S] of all seen patches, frames and coordinates."""
    import pysindy

    derivative = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": _WINDOW, "polyorder": 3, "axis": 0})

    def rate(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.asarray(derivative(flat, episode.times)).reshape(values.shape)

    place, base = episode.pooled(episode.points), episode.pooled(prediction)
    moved, velocity = place - place[:1], rate(place)
    acceleration, of_base = rate(velocity), rate(rate(base))
    near = cKDTree(place[0]).query(place[0], k=min(_NEIGHBOURS + 1, place.shape[1]))[1][:, 1:]

    def laplacian(values: np.ndarray) -> np.ndarray:
        return np.asarray((values[:, near] - values[:, :, None]).mean(2))

    stretch = moved[:, near] - moved[:, :, None]
    cubic = (stretch * (stretch**2).sum(-1, keepdims=True)).mean(2)
    one = np.ones_like(moved)
    growth = (place[:1] - place[:1].mean(1, keepdims=True)) * (episode.times - episode.times[0])[:, None, None]
    tool_place, tool_velocity = _tool(episode, place)
    gap = tool_place - place
    distance = np.linalg.norm(gap, axis=-1, keepdims=True)
    touching = distance < _NEAR_TOOL_M
    floor = place[..., 2:].min() if episode.table_z_m is None else episode.table_z_m
    on_table = place[..., 2:] < floor + _NEAR_TABLE_M
    terms: dict[str, Any] = {
        "velocity": velocity,
        "laplacian of displacement": laplacian(moved),
        "laplacian of displacement, cubic": cubic,
        "laplacian of displacement along x": laplacian(moved) * [1, 0, 0],
        "laplacian of faded displacement": laplacian(_faded(moved, episode.times)),
        "laplacian of velocity": laplacian(velocity),
        "x": one * [1, 0, 0],
        "y": one * [0, 1, 0],
        "growth": laplacian(growth),
        "sliding on the table": on_table * _direction(velocity * [1, 1, 0]),
        "towards the tool": touching * _direction(gap),
        "sliding along the tool": touching * _direction(tool_velocity - velocity),
        "acceleration of the base": of_base,
    }
    inside = slice(_WINDOW // 2, len(episode.times) - _WINDOW // 2)  # the ends of a smoothed derivative mean little
    seen = episode.seen_patches[inside]
    columns = [terms[name][inside][seen].ravel() for name in STANDS_FOR]
    return np.stack(columns, 1), (acceleration - of_base)[inside][seen].ravel()


def _faded(moved: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Displacement as a Maxwell element remembers it, [T, K, 3]."""
    faded = np.zeros_like(moved)
    for t in range(1, len(times)):
        keep = np.exp(-(times[t] - times[t - 1]) / _RELAXATION_S)
        faded[t] = keep * (faded[t - 1] + moved[t] - moved[t - 1])
    return faded


def _direction(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-4))


def _tool(episode: Episode, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearest corner of the tool to each patch and its velocity, [T, K, 3] each [m, m/s]."""
    poses = episode.tool.world_from_tool
    corners = np.einsum("tij,vj->tvi", poses[:, :3, :3], episode.tool.vertices) + poses[:, None, :3, 3]
    speed = np.gradient(corners, episode.times, axis=0)
    nearest = [cKDTree(now).query(patches)[1] for now, patches in zip(corners, place, strict=True)]
    rows = np.arange(len(place))[:, None]
    return corners[rows, np.stack(nearest)], speed[rows, np.stack(nearest)]
