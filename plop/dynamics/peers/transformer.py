"""A transformer over particles, after ParticleFormer (Huang et al., CoRL 2025).

Every particle, of the object or of the tool, is a token of its position and features; blocks of attention (Vaswani et
al., 2017, Eq. 1; normalised before each sublayer) let all of them interact, whatever their distance, without a graph:

    x <- x + MHA(LN(x)),  x <- x + FFN(LN(x)),  motion_i = f_D(LN(x_i))

Positions enter as coordinates: the network is equivariant under permutation, and under nothing else.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

_QUERIES = 4096
"""Particles whose attention is computed at once: memory grows with the number of particles and not with its square."""


class _Block(nn.Module):
    """Attention and feed-forward network, each added to its input."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before_attention, self.before_feed = nn.LayerNorm(width), nn.LayerNorm(width)
        self.joint = nn.Linear(width, 3 * width)
        self.joined = nn.Linear(width, width)
        self.feed = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), nn.Linear(2 * width, width))

    def forward(self, tokens: Tensor) -> Tensor:
        """Mix the tokens, [P, width] -> [P, width]."""
        query, key, value = self.joint(self.before_attention(tokens)).chunk(3, dim=1)
        key, value = (self._by_head(part) for part in (key, value))
        found = [
            nn.functional.scaled_dot_product_attention(self._by_head(part), key, value)
            for part in query.split(_QUERIES)
        ]
        mixed = torch.cat(found, dim=2)[0].transpose(0, 1).reshape(len(tokens), -1)
        tokens = tokens + self.joined(mixed)
        result: Tensor = tokens + self.feed(self.before_feed(tokens))
        return result

    def _by_head(self, values: Tensor) -> Tensor:
        """Split channels over heads, [P, width] -> [1, heads, P, width / heads]."""
        return values.reshape(len(values), self.heads, -1).transpose(0, 1)[None]


class ParticleTransformer(nn.Module):
    """Predict a vector for every particle from all particles."""

    def __init__(self, inputs: int, width: int, layers: int, heads: int, outputs: int = 3) -> None:
        """Create the network.

        Args:
            inputs: Features of a particle.
            width: Channels, a multiple of the heads.
            layers: Blocks.
            heads: Heads of attention.
            outputs: Numbers to predict for each particle.
        """
        super().__init__()
        self.embed = nn.Sequential(nn.Linear(3 + inputs, width), nn.ReLU(), nn.Linear(width, width))
        self.blocks = nn.Sequential(*(_Block(width, heads) for _ in range(layers)))
        self.decode = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, outputs))
        last = self.decode[-1]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=1e-3)
        nn.init.zeros_(last.bias)

    def forward(self, positions: Tensor, features: Tensor) -> Tensor:
        """Predict.

        Args:
            positions: Shape [P, 3], in units of about the object's size.
            features: Shape [P, inputs], of order 1.

        Returns:
            Shape [P, outputs].
        """
        result: Tensor = self.decode(self.blocks(self.embed(torch.cat([positions, features], dim=1))))
        return result
