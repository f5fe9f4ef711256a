"""Edges of a graph over particles: index lists of senders and receivers within a radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor


@dataclass(frozen=True)
class Edges:
    """E directed edges, sorted by receiver."""

    senders: Tensor
    """Shape [E], int64."""
    receivers: Tensor
    """Shape [E], int64."""


def radius_edges(positions: Tensor, objects: int, radius: float, most: int) -> Edges:
    """Join every particle of the object with its neighbours in the object and in the tool.

    The tool's motion is given, so that no edge leads to it.

    Args:
        positions: The object's particles first, then the tool's, shape [M + K, 3].
        objects: M.
        radius: Longest edge, in the unit of the positions.
        most: Most edges into a particle from the object, and from the tool, the shortest ones; 0: all.

    Returns:
        The edges; no particle is its own neighbour.
    """
    points = positions.detach().cpu().double().numpy()
    inner, outer = points[:objects], points[objects:]
    found = [_neighbours(inner, inner, radius, most, own=True)]
    if len(outer):
        sender, receiver = _neighbours(inner, outer, radius, most, own=False)
        found.append((sender + objects, receiver))
    sender, receiver = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(receiver, kind="stable")
    device = positions.device
    return Edges(torch.from_numpy(sender[order]).to(device), torch.from_numpy(receiver[order]).to(device))


def _neighbours(
    receivers: np.ndarray, senders: np.ndarray, radius: float, most: int, *, own: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return senders and receivers of all edges; `own` leaves out those from a particle to itself."""
    tree = cKDTree(senders)
    if most == 0:
        pairs = cKDTree(receivers).sparse_distance_matrix(tree, radius, output_type="ndarray")
        pairs = pairs[np.lexsort((pairs["j"], pairs["i"]))]
        sender, receiver = pairs["j"].astype(np.int64), pairs["i"].astype(np.int64)
    else:
        wanted = min(most + own, len(senders))
        _, index = tree.query(receivers, k=list(range(1, wanted + 1)), distance_upper_bound=radius)
        row = np.repeat(np.arange(len(receivers)), wanted)
        sender, receiver = index.reshape(-1).astype(np.int64), row
        inside = sender < len(senders)
        sender, receiver = sender[inside], receiver[inside]
    if own:
        others = sender != receiver
        sender, receiver = sender[others], receiver[others]
    return sender, receiver
