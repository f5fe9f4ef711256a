"""Gaussians as free parameters: logits and logarithms, one learning rate per group."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from plop.gaussians.state import Gaussians, concatenate

if TYPE_CHECKING:
    from stages.fit_init.stage import FitInitConfig

_MARGIN = 1e-4


class Parameters:
    """Free parameters of N Gaussians with their Adam state, which follows when their number changes."""

    def __init__(self, gaussians: Gaussians, config: FitInitConfig, spacing_m: float) -> None:
        self._rates = {
            "means": config.lr_means * spacing_m,
            "quats": config.lr_quats,
            "scales": config.lr_scales,
            "opacities": config.lr_opacities,
            "sh": config.lr_sh,
        }
        self._limits = math.log(0.1), math.log(config.max_scale)
        self.ids, self._spacing_m = gaussians.ids, spacing_m
        self._free = self._to_free(gaussians)
        self._build()

    def _build(self) -> None:
        self._free = {name: values.detach().clone().requires_grad_() for name, values in self._free.items()}
        groups = [{"params": [self._free[name]], "lr": rate} for name, rate in self._rates.items()]
        self.adam = torch.optim.Adam(groups, eps=1e-15)

    def __len__(self) -> int:
        return len(self.ids)

    def gaussians(self) -> Gaussians:
        """Return the Gaussians, with gradients to the free parameters."""
        free = self._free
        return Gaussians(
            means=free["means"],
            quats=torch.nn.functional.normalize(free["quats"], dim=-1),
            scales=self._spacing_m * free["scales"].exp(),
            opacities=torch.sigmoid(free["opacities"]),
            sh=free["sh"],
            ids=self.ids,
        )

    def pull(self) -> Tensor:
        """Return the length of each mean's gradient after a backward pass, shape [N]."""
        grad = self._free["means"].grad
        return self._free["means"].new_zeros(len(self)) if grad is None else grad.norm(dim=1)

    def step(self, progress: float) -> None:
        """Take one Adam step; as progress goes from 0 to 1, rates fall to a tenth, those of the means to 2 %."""
        for group, (name, rate) in zip(self.adam.param_groups, self._rates.items(), strict=True):
            group["lr"] = rate * (0.02 if name == "means" else 0.1) ** progress
        self.adam.step()
        self.adam.zero_grad(set_to_none=True)
        with torch.no_grad():
            self._free["scales"].clamp_(*self._limits)

    def replace(self, gaussians: Gaussians, parents: Tensor) -> None:
        """Replace the Gaussians; each inherits the Adam moments of its parent row."""
        old = [(group["params"][0], name) for group, name in zip(self.adam.param_groups, self._rates, strict=True)]
        states = {name: self.adam.state.get(tensor, {}) for tensor, name in old}
        self._free, self.ids = self._to_free(gaussians), gaussians.ids
        self._build()
        for name, state in states.items():
            if state:
                moments = {key: state[key][parents].clone() for key in ("exp_avg", "exp_avg_sq")}
                self.adam.state[self._free[name]] = {"step": state["step"].clone(), **moments}

    def append(self, gaussians: Gaussians) -> None:
        """Add Gaussians, without moments."""
        count = len(self)
        old = torch.arange(count, device=self.ids.device)
        self.replace(
            concatenate([self.gaussians().detach(), gaussians]), torch.cat([old, old.new_zeros(len(gaussians))])
        )
        for state in self.adam.state.values():
            state["exp_avg"][count:] = 0
            state["exp_avg_sq"][count:] = 0

    def _to_free(self, gaussians: Gaussians) -> dict[str, Tensor]:
        """Sizes are counted in spacings: their logarithms, rounding included, are then the same in any unit."""
        return {
            "means": gaussians.means.detach(),
            "quats": gaussians.quats.detach(),
            "scales": (gaussians.scales.detach() / self._spacing_m).log(),
            "opacities": torch.logit(gaussians.opacities.detach().clamp(_MARGIN, 1 - _MARGIN)),
            "sh": gaussians.sh.detach(),
        }
