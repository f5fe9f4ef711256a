"""Cohesion: material that no blade has divided stays together, and a Gaussian stays with its neighbours.

The network moves every Gaussian independently. Beside a blade, a few move with it that should rest, or rest when
they should move; once they have left their half nothing returns them, and they bridge the gap of the cut. A body that
is not torn moves almost rigidly within some millimetres. Therefore the prediction is limited: the distance of each
Gaussian from the position predicted by its neighbours on its side is at most that of Gaussians in the training tracks.
The loss of the paper (Eq. 15) has rigidity and isometry terms for this, but only in training and only in the mean.

The position comes from the best rigid motion of the neighbours since the first frame, fitted by iteratively reweighted
least squares with Cauchy's weights, so that outliers have little weight; rotations after Mueller et al., "A
robust method to extract the rotational part of deformations" (MIG 2016).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from plop.compute.cpu_kernels import array_of, kernel, run_parallel
from plop.dynamics.interface import ParticleState
from plop.dynamics.rest import RestPlaces

_ROUNDS = 3
"""Iterations of the reweighted fit."""
_SOFT = 0.05
"""Distance from the fit at which a neighbour counts half, in units of the distance to the farthest neighbour [-]."""
_LEAST = 4
"""Fewer neighbours do not determine a rotation."""
_TURNS = 30
"""Most iterations of a rotation; a few degrees need three."""
_NATURAL = 0.99
"""Share of the Gaussians of a track that count as inliers."""


@kernel
def _turn_by(q: np.ndarray, x: float, y: float, z: float) -> None:
    """Turn the quaternion q (wxyz) by a small rotation vector, in place."""
    angle = np.sqrt(x * x + y * y + z * z)
    s, c = np.sin(0.5 * angle) / max(angle, 1e-20), np.cos(0.5 * angle)
    a, b, d, e = q[0], q[1], q[2], q[3]
    x, y, z = s * x, s * y, s * z
    q[0] = c * a - x * b - y * d - z * e
    q[1] = c * b + x * a + y * e - z * d
    q[2] = c * d + y * a + z * b - x * e
    q[3] = c * e + z * a + x * d - y * b
    norm = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for m in range(4):
        q[m] /= norm


@kernel
def _matrix_of(q: np.ndarray, turn: np.ndarray) -> None:
    """Rotation matrix of the quaternion q (wxyz)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@kernel
def _fit_turn(spread: np.ndarray, q: np.ndarray, turn: np.ndarray) -> None:
    """Turn q until its matrix is the rotation nearest to `spread` = sum w now rest^T; both are overwritten."""
    for _ in range(_TURNS):
        _matrix_of(q, turn)
        x, y, z, along = 0.0, 0.0, 0.0, 1e-30
        for c in range(3):
            x += turn[1, c] * spread[2, c] - turn[2, c] * spread[1, c]
            y += turn[2, c] * spread[0, c] - turn[0, c] * spread[2, c]
            z += turn[0, c] * spread[1, c] - turn[1, c] * spread[0, c]
            along += turn[0, c] * spread[0, c] + turn[1, c] * spread[1, c] + turn[2, c] * spread[2, c]
        x, y, z = x / abs(along), y / abs(along), z / abs(along)
        _turn_by(q, x, y, z)
        if x * x + y * y + z * z < 1e-10:
            break
    _matrix_of(q, turn)


@kernel
def _expected(
    part: int,
    parts: int,
    rows: np.ndarray,
    rest: np.ndarray,
    now: np.ndarray,
    side: np.ndarray,
    neighbours: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write for each of `rows` the position predicted by its neighbours; its own where it has too few of them."""
    weight = np.empty(neighbours.shape[1])
    then, here, spread, turn, q = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(4)
    for r in range(part * len(rows) // parts, (part + 1) * len(rows) // parts):
        i, found, far = rows[r], 0, 0.0
        for k in range(neighbours.shape[1]):
            j = neighbours[i, k]
            weight[k] = 1.0 if side[i] * side[j] >= 0 else 0.0
            found += 1 if weight[k] > 0 else 0
            far = max(
                far, (rest[j, 0] - rest[i, 0]) ** 2 + (rest[j, 1] - rest[i, 1]) ** 2 + (rest[j, 2] - rest[i, 2]) ** 2
            )
        if found < _LEAST:
            for c in range(3):
                out[r, c] = now[i, c]
            continue
        soft = max(_SOFT**2 * far, 1e-20)
        q[0], q[1], q[2], q[3] = 1.0, 0.0, 0.0, 0.0
        for attempt in range(_ROUNDS):
            total = 0.0
            then[:], here[:], spread[:] = 0.0, 0.0, 0.0
            for k in range(neighbours.shape[1]):
                j = neighbours[i, k]
                total += weight[k]
                for c in range(3):
                    then[c] += weight[k] * rest[j, c]
                    here[c] += weight[k] * now[j, c]
            for c in range(3):
                then[c] /= total
                here[c] /= total
            for k in range(neighbours.shape[1]):
                j = neighbours[i, k]
                for c in range(3):
                    for d in range(3):
                        spread[c, d] += weight[k] * (now[j, c] - here[c]) * (rest[j, d] - then[d])
            _fit_turn(spread, q, turn)
            if attempt + 1 == _ROUNDS:
                break
            for k in range(neighbours.shape[1]):
                j = neighbours[i, k]
                off = 0.0
                for c in range(3):
                    miss = now[j, c] - here[c]
                    for d in range(3):
                        miss -= turn[c, d] * (rest[j, d] - then[d])
                    off += miss * miss
                weight[k] = 1 / (1 + off / soft) if side[i] * side[j] >= 0 else 0.0
        for c in range(3):
            out[r, c] = here[c]
            for d in range(3):
                out[r, c] += turn[c, d] * (rest[i, d] - then[d])


def expected_places(rest: RestPlaces, means: Tensor, side: Tensor, rows: Tensor | None = None) -> Tensor:
    """Return the positions of Gaussians predicted by their neighbours.

    Computed on the CPU, wherever the tensors live.

    Args:
        rest: The first frame.
        means: Now, shape [N, 3] [m].
        side: Side of the cut, shape [N]; neighbours across it do not count.
        rows: Indices of the Gaussians, shape [M], int64; all when absent.

    Returns:
        Shape [M, 3] [m], without gradient.
    """
    wanted = np.arange(len(means)) if rows is None else array_of(rows.cpu())
    out = np.empty((len(wanted), 3))
    arrays = (array_of(rest.places.cpu().double()), array_of(means.cpu().double()), array_of(side.cpu().double()))
    run_parallel([(_expected, (wanted, *arrays, rest.neighbours, out))])
    return torch.from_numpy(out).to(means)


def held_together(before: ParticleState, after: ParticleState, stray_m: float | None) -> ParticleState:
    """Limit the distance of Gaussians from their neighbours after a step.

    Args:
        before: State at the start of the step.
        after: Prediction for its end, the same Gaussians in the same order.
        stray_m: Largest distance of a Gaussian from the position predicted by its neighbours [m]. One that was
            farther away before (after an update of the filter) may stay as far. None: no limit.

    Returns:
        The prediction, with outliers moved straight towards their predicted position until within the limit.
    """
    rest = after.rest
    if stray_m is None or rest is None:
        return after
    means = after.gaussians.means
    offset = means - expected_places(rest, means, after.side)
    rows = torch.nonzero(offset.norm(dim=-1) > stray_m).squeeze(1)
    if len(rows) == 0:
        return after
    earlier = before.gaussians.means[rows] - expected_places(rest, before.gaussians.means, before.side, rows)
    allowed = earlier.norm(dim=-1).clamp_min(stray_m)
    length = offset[rows].norm(dim=-1)
    back = torch.zeros_like(means)
    back[rows] = offset[rows] * ((allowed / length).clamp_max(1) - 1)[:, None]
    return replace(
        after, gaussians=after.gaussians.with_(means=means + back), last_translation=after.last_translation + back
    )


def natural_strays_m(rest: RestPlaces, means: Tensor, sides: Tensor) -> float:
    """Measure the distance of Gaussians in an episode from the positions predicted by their neighbours.

    Args:
        rest: The first frame.
        means: Some frames, shape [T, N, 3] [m].
        sides: Sides of the cut, shape [T, N].

    Returns:
        99th percentile of the distance in each of these frames [m].
    """
    offsets = [now - expected_places(rest, now, side) for now, side in zip(means, sides, strict=True)]
    return max(float(torch.quantile(offset.norm(dim=-1), _NATURAL)) for offset in offsets)
