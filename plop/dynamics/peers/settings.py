"""Sizes of the networks that I2N is compared with; the defaults give each about as many parameters as I2N."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from plop.errors import PlopError
from plop.setting_kinds import Range, Settings, Unit

PeerName = Literal["gs-dynamics", "dpi-net", "transformer"]


@dataclass(frozen=True)
class SampledConfig(Settings):
    """Which particles a network sees, and how the Gaussians follow them."""

    particles: Annotated[int, Range(0), Unit("particles")] = 100
    """Particles that represent the object, drawn by farthest point sampling in every step; 0 takes every Gaussian."""
    tool_points: Annotated[int, Range(1), Unit("points")] = 64
    """Most points of the tool near the object that are particles, too."""
    tool_reach: Annotated[float, Range(0, 100, above=True)] = 0.4
    """Distance from the object up to which points of the tool count, in lengths of the object."""
    bones: Annotated[int, Range(0), Unit("particles")] = 0
    """Nearest particles that move a Gaussian, weighted by the inverse of their distance; 0: all, as published."""


@dataclass(frozen=True)
class GraphConfig(SampledConfig):
    """Size of a propagation network over the edges of a graph."""

    width: Annotated[int, Range(2, 4096)] = 196
    """Channels of nodes and edges."""
    propagations: Annotated[int, Range(1, 64), Unit("steps")] = 3
    """Steps of message passing."""
    neighbours: Annotated[int, Range(0), Unit("edges")] = 6
    """Most edges into a particle from the object, and as many from the tool; 0: all within the radius."""
    radius: Annotated[float, Range(0, 100, above=True)] = 0.4
    """Longest edge, in lengths of the object."""


@dataclass(frozen=True)
class TransformerConfig(SampledConfig):
    """Size of a transformer over particles."""

    particles: Annotated[int, Range(0), Unit("particles")] = 300
    """Particles that represent the object, drawn by farthest point sampling in every step; 0 takes every Gaussian."""
    bones: Annotated[int, Range(0), Unit("particles")] = 8
    """Nearest particles that move a Gaussian, weighted by the inverse of their distance; 0: all."""
    width: Annotated[int, Range(2, 4096)] = 128
    """Channels of a particle; a multiple of the heads."""
    layers: Annotated[int, Range(1, 64), Unit("layers")] = 3
    """Blocks of attention and feed-forward network."""
    heads: Annotated[int, Range(1, 64), Unit("heads")] = 4
    """Heads of attention."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width % self.heads:
            raise PlopError(
                "The transformer's channels cannot be shared among its heads.",
                where="transformer.width, transformer.heads",
                expected=f"a multiple of {self.heads} heads",
                found=str(self.width),
                fix="Change one of them.",
            )


def dpi_net() -> GraphConfig:
    """Return DPI-Net's defaults: more particles than gs-dynamics, longer lists of neighbours, fewer steps."""
    return GraphConfig(particles=300, bones=8, width=196, propagations=2, neighbours=12)


@dataclass(frozen=True)
class PeerSettings(Settings):
    """The peers' settings, one group each."""

    gs_dynamics: GraphConfig = GraphConfig()
    """Network of gs-dynamics."""
    dpi_net: GraphConfig = field(default_factory=dpi_net)
    """Network of DPI-Net."""
    transformer: TransformerConfig = TransformerConfig()
    """The particle transformer."""

    def of(self, name: PeerName) -> GraphConfig | TransformerConfig:
        """Return one peer's settings."""
        found: GraphConfig | TransformerConfig = getattr(self, name.replace("-", "_"))
        return found
