"""3D convolutions of small grids on the CPU: by oneDNN, forward and backward, also for one sample alone.

PyTorch does not use oneDNN for a single small sample, and its own gradients take several times as long;
`python -m benchmarks.speed train` measures a training step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn


@dataclass(frozen=True)
class _ConvForm:
    padding: tuple[int, ...]
    stride: tuple[int, ...]
    dilation: tuple[int, ...]
    groups: int


class _DirectConvolution(torch.autograd.Function):
    """A convolution and its gradients; tensors in oneDNN's own layout do not leave this class."""

    @staticmethod
    def forward(ctx: Any, input: Tensor, weight: Tensor, bias: Tensor | None, form: _ConvForm) -> Tensor:
        ctx.save_for_backward(input, weight)
        ctx.form, ctx.bias_sizes = form, None if bias is None else list(bias.shape)
        return torch.mkldnn_convolution(input, weight, bias, form.padding, form.stride, form.dilation, form.groups)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        input, weight = ctx.saved_tensors
        (grad,) = gradients
        form: _ConvForm = ctx.form
        found = torch.ops.aten.convolution_backward(
            grad.contiguous().to_mkldnn(),
            input.to_mkldnn(),
            weight,
            ctx.bias_sizes,
            form.stride,
            form.padding,
            form.dilation,
            False,
            [0, 0, 0],
            form.groups,
            list(ctx.needs_input_grad[:3]),
        )
        return *(g.to_dense() if g is not None and g.is_mkldnn else g for g in found), None


class DirectConv3d(nn.Conv3d):
    """A 3D convolution that calls oneDNN on the CPU also for a single small sample; the numbers agree to rounding."""

    def forward(self, input: Tensor) -> Tensor:
        """Convolve, shape [B, C, X, Y, Z]."""
        if input.device.type != "cpu" or input.dtype != torch.float32 or not torch.backends.mkldnn.is_available():
            return super().forward(input)
        assert not isinstance(self.padding, str)
        form = _ConvForm(self.padding, self.stride, self.dilation, self.groups)
        result: Tensor = _DirectConvolution.apply(input, self.weight, self.bias, form)
        return result
