"""I2N, the Implicit Particle Interaction Network (PLOP, Sec. III-E).

Encode particles, average their features on a grid, let 3D convolutions solve the grid, interpolate back,
decode the update of each particle. No pairs of particles are evaluated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor, nn

from plop.dynamics.activation import SiLU
from plop.dynamics.i2n.convolution import DirectConv3d
from plop.dynamics.i2n.features import OBJECT_FEATURES, TOOL_FEATURES, FeatureSet
from plop.dynamics.particle_grid.grid import fit_grid
from plop.dynamics.particle_grid.kernels import Kernel, build_stencil
from plop.dynamics.particle_grid.transfer import g2p, p2g
from plop.setting_kinds import COMMON, Range, Settings, Unit

STRIDE = 4
"""The grid network halves the resolution twice."""
_LANES = 16
"""Numbers in the widest vector register; products of fewer columns take up to four times as long."""
OUTPUTS: dict[FeatureSet, int] = {"paper": 11, "contact": 11, "oriented": 12}
"""Translation 3, rotation vector 3, log-scale 3, opacity logit 1, share of the tool's motion 1; share of its mirror
image 1."""


@dataclass(frozen=True)
class I2NConfig(Settings):
    """Size and type of the network; the defaults are defined only here."""

    kernel: Kernel = "quadratic"
    """Kernel between particles and grid: "paper" (8 nodes), "quadratic" (27) or "cubic" (64)."""
    features: Annotated[FeatureSet, COMMON] = "contact"
    """Input features of a particle; "contact" adds position and motion relative to the tool, "oriented" also the
    orientation of the table: for a table with different friction along x and y, such as DiSECt's."""
    width: Annotated[int, Range(2, 4096)] = 24
    """Channels of particles and of the finest grid."""
    cells_across: Annotated[float, Range(1, 256), Unit("cells")] = 8.0
    """Grid cells along the object's longest extent; sets the spacing h."""


@dataclass(frozen=True)
class ParticleBatch:
    """Particles of B steps, one after the other."""

    positions: Tensor
    """Positions in the frame of the step, shape [N, 3] [m]."""
    features: Tensor
    """Shape [N, F]."""
    batch: Tensor
    """Step of each particle, shape [N], int64."""


def _mlp(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), SiLU(), nn.Linear(hidden, outputs))


class GridNetwork(nn.Module):
    """Solve the grid: two levels of convolution down, two of deconvolution up, with skips (Fig. 3d)."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.enter = DirectConv3d(inputs, width, 3, padding=1)
        self.down1 = DirectConv3d(width, 2 * width, 3, stride=2, padding=1)
        self.mid1 = DirectConv3d(2 * width, 2 * width, 3, padding=1)
        self.down2 = DirectConv3d(2 * width, 2 * width, 3, stride=2, padding=1)
        self.mid2 = DirectConv3d(2 * width, 2 * width, 3, padding=1)
        self.up2 = nn.ConvTranspose3d(2 * width, 2 * width, 2, stride=2)
        self.join1 = DirectConv3d(4 * width, 2 * width, 3, padding=1)
        self.up1 = nn.ConvTranspose3d(2 * width, width, 2, stride=2)
        self.join0 = DirectConv3d(2 * width, width, 3, padding=1)
        self.act = SiLU()

    def forward(self, grid: Tensor) -> Tensor:
        """Map node features to solved node features, [B, inputs, X, Y, Z] -> [B, width, X, Y, Z]."""
        fine = self.act(self.enter(grid))
        middle = self.act(self.down1(fine))
        middle = middle + self.act(self.mid1(middle))
        coarse = self.act(self.down2(middle))
        coarse = coarse + self.act(self.mid2(coarse))
        middle = self.act(self.join1(torch.cat([middle, self.up2(coarse)], dim=1)))
        result: Tensor = self.act(self.join0(torch.cat([fine, self.up1(middle)], dim=1)))
        return result


class I2N(nn.Module):
    """Predict the update of every particle from particles, tool and grid."""

    def __init__(self, config: I2NConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        self.encode_object = _mlp(OBJECT_FEATURES[config.features], 2 * width, width)
        self.encode_tool = _mlp(TOOL_FEATURES, width, width // 2)
        # Two more channels mark the nodes with object and tool.
        self.solve = GridNetwork(width + width // 2 + 2, width)
        self.decode = _mlp(2 * width, 2 * width, OUTPUTS[config.features])
        last = self.decode[-1]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=1e-3)
        nn.init.zeros_(last.bias)
        # Scales and opacities are learned from images only; until then they stay unchanged.
        with torch.no_grad():
            last.weight[6:10] = 0

    def forward(self, particles: ParticleBatch, tool: ParticleBatch, batches: int, spacing_m: float) -> Tensor:
        """Run Eq. 16-24.

        Args:
            particles: The object's particles of all steps.
            tool: The tool's particles of all steps.
            batches: Number of steps B.
            spacing_m: Grid spacing h [m].

        Returns:
            Raw updates, shape [N, OUTPUTS[features]].
        """
        box = fit_grid(particles.positions, particles.batch, batches, spacing_m, stride=STRIDE)
        encoded = self.encode_object(particles.features)
        origin = box.origin if batches == 1 else box.origin[particles.batch]
        kernel = self.config.kernel
        stencil = build_stencil(particles.positions - origin, spacing_m, box.shape, kernel, particles.batch, batches)
        object_nodes, object_mass = p2g(encoded, stencil)
        tool_nodes, tool_mass = self._tool_grid(tool, box.origin, box.shape, spacing_m, box.size * batches)
        nodes = torch.cat([object_nodes, tool_nodes, _occupancy(object_mass), _occupancy(tool_mass)], dim=1)
        grid = nodes.reshape(batches, *box.shape, -1).permute(0, 4, 1, 2, 3).contiguous()
        solved = self.solve(grid).permute(0, 2, 3, 4, 1).reshape(batches * box.size, -1).contiguous()
        return self._decoded(g2p(solved, stencil), encoded)

    def _decoded(self, solved: Tensor, encoded: Tensor) -> Tensor:
        """Decode grid and particle features, [N, width] each, without concatenating them."""
        first, act, last = self.decode
        assert isinstance(first, nn.Linear) and isinstance(last, nn.Linear)
        of_grid, of_particle = first.weight.split([solved.shape[1], encoded.shape[1]], dim=1)
        hidden = torch.addmm(first.bias, solved, of_grid.T).addmm_(encoded, of_particle.T)
        return _padded_linear(act(hidden), last)

    def _tool_grid(
        self, tool: ParticleBatch, origin: Tensor, shape: tuple[int, int, int], spacing_m: float, nodes: int
    ) -> tuple[Tensor, Tensor]:
        """Average the tool's features on the nodes; tool particles outside the grid are ignored."""
        local = tool.positions - origin[tool.batch]
        limit = local.new_tensor(shape) * spacing_m - 2 * spacing_m
        near = ((local > spacing_m) & (local < limit)).all(-1)
        width = self.config.width // 2
        if not bool(near.any()):
            return local.new_zeros(nodes, width), local.new_zeros(nodes, 1)
        stencil = build_stencil(local[near], spacing_m, shape, self.config.kernel, tool.batch[near], len(origin))
        return p2g(self.encode_tool(tool.features[near]), stencil)


def _occupancy(mass: Tensor) -> Tensor:
    """Squash the mass of a node to [0, 1): 0 exactly where nothing is."""
    return mass / (mass + 1.0)


def _padded_linear(values: Tensor, layer: nn.Linear) -> Tensor:
    """Apply a layer of few outputs, [N, inputs] -> [N, outputs]; on the CPU as one of a full vector, which is faster.

    With each particle as a column it would be as fast, but its last digits would depend on the number of threads.
    """
    missing = -layer.out_features % _LANES
    weight, bias = nn.functional.pad(layer.weight, (0, 0, 0, missing)), nn.functional.pad(layer.bias, (0, missing))
    return nn.functional.linear(values, weight, bias)[:, : layer.out_features]
