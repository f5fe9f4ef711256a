"""A propagation network over a graph of particles: DPI-Net and the network of gs-dynamics.

Li et al., "Learning particle dynamics for manipulating rigid bodies, deformable objects, and fluids" (ICLR 2019),
Eq. 2-4: nodes and edges are encoded, effects travel along the edges for L steps, a decoder reads the motion:

    c_i = f_O(o_i),  c_k = f_R(o_i, o_j, r_k),  h_i^0 = c_i
    e_k^l = phi_R(c_k, h_i^{l-1}, h_j^{l-1}),  h_i^l = phi_O(c_i, sum_k e_k^l) + h_i^{l-1}
    motion_i = f_D(h_i^L)

gs-dynamics (Zhang et al., CoRL 2024) uses the same network with three steps over sampled points.

The edges are index lists: an effect is gathered with `index_select` and summed with `index_add`. Published code
multiplies with one-hot matrices of edges times particles, which gives the same numbers. phi_R is one layer, so that
its product with the concatenation is the sum of three products: those with h are computed once a particle and
then gathered, not once an edge.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from plop.dynamics.peers.edges import Edges

_RELATION = 4
"""Features of an edge besides those of its ends: relative position and distance."""


def _mlp(inputs: int, width: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, outputs)
    )


class PropagationNetwork(nn.Module):
    """Predict a vector for every particle; invariant under translation, equivariant under permutation."""

    def __init__(self, inputs: int, width: int, propagations: int, outputs: int = 3) -> None:
        """Create the network.

        Args:
            inputs: Features of a particle.
            width: Channels.
            propagations: Steps of message passing.
            outputs: Numbers to predict for each particle.
        """
        super().__init__()
        self.propagations = propagations
        self.encode_node = _mlp(inputs, width, width)
        self.encode_edge = _mlp(2 * inputs + _RELATION, width, width)
        self.along_edge = nn.Linear(3 * width, width)
        self.at_node = nn.Linear(2 * width, width)
        self.decode = _mlp(width, width, outputs)
        last = self.decode[-1]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=1e-3)
        nn.init.zeros_(last.bias)

    def forward(self, positions: Tensor, features: Tensor, edges: Edges) -> Tensor:
        """Propagate effects.

        Args:
            positions: Shape [P, 3], in units of about the object's size.
            features: Shape [P, inputs], of order 1; positions are not among them.
            edges: Between the particles.

        Returns:
            Shape [P, outputs].
        """
        count = len(positions)
        sent, received = (self._gather(torch.cat([positions, features], 1), to, count) for to in _ends(edges))
        relative = received[:, :3] - sent[:, :3]
        # Smooth at zero: two particles may lie at the same position.
        distance = (relative.square().sum(1, keepdim=True) + 1e-12).sqrt()
        edge = torch.relu(self.encode_edge(torch.cat([relative, distance, received[:, 3:], sent[:, 3:]], 1)))
        node = torch.relu(self.encode_node(features))
        of_edge, of_receiver, of_sender = self.along_edge.weight.chunk(3, dim=1)
        constant = torch.addmm(self.along_edge.bias, edge, of_edge.T)
        effect = node
        for _ in range(self.propagations):
            passed = self._gather(effect @ of_receiver.T, edges.receivers, count)
            passed = passed + self._gather(effect @ of_sender.T, edges.senders, count)
            summed = self._summed(torch.relu(constant + passed), edges.receivers, count)
            effect = torch.relu(self.at_node(torch.cat([node, summed], 1)) + effect)
        result: Tensor = self.decode(effect)
        return result

    def _gather(self, values: Tensor, index: Tensor, count: int) -> Tensor:
        """Read the particles' values at one end of every edge, [P, C] -> [E, C]."""
        return values.index_select(0, index)

    def _summed(self, values: Tensor, receivers: Tensor, count: int) -> Tensor:
        """Sum the edges' values at their receivers, [E, C] -> [P, C]."""
        return values.new_zeros(count, values.shape[1]).index_add(0, receivers, values)


def _ends(edges: Edges) -> tuple[Tensor, Tensor]:
    return edges.senders, edges.receivers
