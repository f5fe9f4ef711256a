"""Edges of a graph over particles: index lists of senders and receivers within a radius."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

_PAIRS = 2**26
"""Pairs that are compared at once."""


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
    places = positions.detach()
    inner, outer = places[:objects], places[objects:]
    search = _compared if places.is_cuda else _in_tree
    found = [search(inner, inner, radius, most, own=True)]
    if len(outer):
        sender, receiver = search(inner, outer, radius, most, own=False)
        found.append((sender + objects, receiver))
    sender, receiver = (torch.cat(parts) for parts in zip(*found, strict=True))
    order = torch.argsort(receiver, stable=True)
    return Edges(sender[order], receiver[order])


def _compared(receivers: Tensor, senders: Tensor, radius: float, most: int, *, own: bool) -> tuple[Tensor, Tensor]:
    """Return senders and receivers of all edges by comparing all pairs, which a GPU does faster than building a tree.

    `own` leaves out those from a particle to itself.
    """
    found, rows = [], max(1, _PAIRS // max(len(senders), 1))
    for first in range(0, max(len(receivers), 1), rows):
        part = receivers[first : first + rows]
        apart = torch.cdist(part, senders, compute_mode="donot_use_mm_for_euclid_dist")
        if own:
            apart.diagonal(first).fill_(torch.inf)
        if most == 0:
            receiver, sender = torch.nonzero(apart <= radius, as_tuple=True)
        else:
            distance, index = apart.topk(min(most, len(senders)), dim=1, largest=False)
            receiver, number = torch.nonzero(distance <= radius, as_tuple=True)
            sender = index[receiver, number]
        found.append((sender, receiver + first))
    sender, receiver = (torch.cat(parts) for parts in zip(*found, strict=True))
    return sender, receiver


def _in_tree(receivers: Tensor, senders: Tensor, radius: float, most: int, *, own: bool) -> tuple[Tensor, Tensor]:
    """Do the same with a k-d tree, on the CPU."""
    sender, receiver = _neighbours(receivers.double().numpy(), senders.double().numpy(), radius, most, own=own)
    return torch.from_numpy(sender), torch.from_numpy(receiver)


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
