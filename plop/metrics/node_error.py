"""Error of material points against a simulator's truth, in millimetres.

Images do not show whether the right material is where the surface is. A simulator does:
`truth_rms_mm` moves its true nodes with the predicted Gaussians and compares the result
with the true motion. Root mean square of the 3D distance over nodes.

Nodes follow Gaussians by lineage: the descendants of a frame-0 Gaussian represent it by
their opacity-weighted mean. Each node moves rigidly with its eight nearest surviving
ancestors (weighted Kabsch fit, weights 1 / squared distance at frame 0). Orientations are
taken from positions and not from the Gaussians' quaternions, which split and merge renumber.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 8
"""Number of ancestors that move one node."""


def ancestor_means(ids: np.ndarray, means: np.ndarray, opacities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average the descendants of every surviving ancestor.

    Args:
        ids: Ancestor of every Gaussian, shape [N].
        means: Shape [N, 3], metres.
        opacities: Weights, shape [N].

    Returns:
        Surviving ancestors [A], ascending, and their positions [A, 3] in metres.
    """
    ancestors, inverse = np.unique(ids, return_inverse=True)
    weights = np.maximum(opacities.astype(np.float64), 1e-6)
    total = np.bincount(inverse, weights)
    columns = [np.bincount(inverse, weights * means[:, axis]) / total for axis in range(3)]
    return ancestors, np.stack(columns, axis=1)


def move_nodes(nodes: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Move nodes with the points around them.

    Args:
        nodes: Positions at frame 0, shape [V, 3], metres.
        before: Surrounding points at frame 0, shape [A, 3], metres.
        after: The same points later, shape [A, 3], metres.

    Returns:
        Positions of the nodes later, shape [V, 3], metres.
    """
    distance, index = cKDTree(before).query(nodes, k=min(NEIGHBOURS, len(before)))
    distance, index = distance.reshape(len(nodes), -1), index.reshape(len(nodes), -1)
    weights = 1 / (distance**2 + 1e-8)
    weights /= weights.sum(1, keepdims=True)
    source, target = before[index], after[index]
    middle, goal = ((weights[..., None] * part).sum(1) for part in (source, target))
    spread = np.einsum("vk,vki,vkj->vij", weights, source - middle[:, None], target - goal[:, None])
    left, _, right = np.linalg.svd(spread)
    flip = np.ones((len(nodes), 3))
    flip[:, 2] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = np.einsum("vji,vj,vkj->vik", right, flip, left)
    return np.asarray(goal + np.einsum("vij,vj->vi", rotation, nodes - middle))


def rms_mm(nodes: np.ndarray, true_nodes: np.ndarray) -> float:
    """Return the root mean square of the distance between corresponding points, both [V, 3] in metres [mm]."""
    return float(np.sqrt(np.square(nodes - true_nodes).sum(1).mean()) * 1000)
