"""Learned perceptual image patch similarity (Zhang et al., 2018; version 0.1), lower is better.

Convention: images in [0, 1] are mapped to [-1, 1]; a shorter side below 64 px is enlarged
to 64 px (bilinear), because deep layers need more pixels than a small crop has. The network stacks are
written in plain torch. The head weights come from the installed `lpips` or
`torchmetrics` package (extra `lpips`); the ImageNet backbone is a file the user provides. Without either the
score is unavailable, with the reason, and never a number.
"""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from plop.errors import PlopError

Backbone = Literal["alex", "vgg"]

BACKBONE_FILES: dict[Backbone, str] = {"alex": "alexnet-owt-7be5be79.pth", "vgg": "vgg16-397923af.pth"}
"""File names under which torch's model hub keeps the backbones."""

_NO_HEADS = "no package that holds the head weights is installed (pip install torchmetrics)"
_MIN_SIDE_PX = 64
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
_VGG_PLAN = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))


@dataclass(frozen=True)
class Unavailable:
    """A score that cannot be computed here."""

    reason: str


class Lpips(nn.Module):
    """Compare images by the weighted squared difference of their normalised deep features."""

    def __init__(self, backbone: Backbone, backbone_state: dict[str, Tensor], head_state: dict[str, Tensor]) -> None:
        """Build the stack and load its weights.

        Args:
            backbone: "alex" or "vgg".
            backbone_state: Weights named as in torch's model hub ("features.<layer>.weight", ...).
            head_state: One [1, C, 1, 1] weight per tap ("lin<tap>.model.1.weight").

        Raises:
            KeyError or RuntimeError: The weights do not fit the stack.
        """
        super().__init__()
        self.stack, self.taps = alexnet_features() if backbone == "alex" else vgg16_features()
        prefix = "features."
        features = {key[len(prefix) :]: value for key, value in backbone_state.items() if key.startswith(prefix)}
        self.stack.load_state_dict(features)
        self.heads = [head_state[f"lin{tap}.model.1.weight"].float() for tap in range(len(self.taps))]
        self.requires_grad_(False).eval()

    @torch.no_grad()
    def score(self, image: np.ndarray, reference: np.ndarray) -> float:
        """Compare two images of shape [H, W, 3], float, 0..1; 0 is identical."""
        pair = torch.from_numpy(np.stack([image, reference]).astype(np.float32)).permute(0, 3, 1, 2)
        shorter = min(pair.shape[2:])
        if shorter < _MIN_SIDE_PX:
            size = [round(side * _MIN_SIDE_PX / shorter) for side in pair.shape[2:]]
            pair = nn.functional.interpolate(pair, size=size, mode="bilinear", align_corners=False)
        shift, scale = (torch.tensor(value)[:, None, None] for value in (_SHIFT, _SCALE))
        return float(self.distance((2 * pair - 1 - shift) / scale))

    def distance(self, pair: Tensor) -> Tensor:
        """Sum the weighted feature differences of a normalised pair, shape [2, 3, H, W] -> []."""
        total, features = pair.new_zeros(()), pair
        for index, layer in enumerate(self.stack):
            features = layer(features)
            if index in self.taps:
                unit = features / (features.square().sum(1, keepdim=True).sqrt() + 1e-10)
                difference = (unit[:1] - unit[1:]).square()
                total = total + nn.functional.conv2d(difference, self.heads[self.taps.index(index)]).mean()
        return total


def alexnet_features() -> tuple[nn.Sequential, tuple[int, ...]]:
    """Build AlexNet's feature stack with torch's layer numbers, and the layers to tap."""
    stack = nn.Sequential(
        nn.Conv2d(3, 64, 11, stride=4, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
        nn.MaxPool2d(3, 2),
    )
    return stack, (1, 4, 7, 9, 11)


def vgg16_features() -> tuple[nn.Sequential, tuple[int, ...]]:
    """Build VGG16's feature stack with torch's layer numbers, and the layers to tap."""
    layers: list[nn.Module] = []
    taps: list[int] = []
    channels = 3
    for block in _VGG_PLAN:
        for width in block:
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        taps.append(len(layers) - 1)
        layers.append(nn.MaxPool2d(2, 2))
    return nn.Sequential(*layers), tuple(taps)


def load_lpips(backbone: Backbone = "alex", backbone_file: str = "") -> Lpips | Unavailable:
    """Load the score, or return why it is unavailable.

    Args:
        backbone: "alex" or "vgg".
        backbone_file: Path of the backbone's weights; when empty, torch's hub folder
            ($TORCH_HOME/hub/checkpoints) is searched.

    Returns:
        The score, or the reason why there is none.

    Raises:
        PlopError: A backbone file was named that is missing, or weights do not fit.
    """
    path = Path(backbone_file) if backbone_file else hub_folder() / BACKBONE_FILES[backbone]
    if not path.is_file():
        if backbone_file:
            raise PlopError(
                "There is no LPIPS backbone at this path.",
                where=path,
                expected=BACKBONE_FILES[backbone],
                found="no file",
                fix="Correct the path, or leave it empty.",
            )
        also = "" if _head_file(backbone) else f", and {_NO_HEADS}"
        return Unavailable(f"no backbone file {path.name} in torch's hub folder{also}")
    heads = _head_file(backbone)
    if heads is None:
        return Unavailable(_NO_HEADS)
    weights = _tensors(path, backbone, f"Get {BACKBONE_FILES[backbone]} again.")
    head_weights = _tensors(heads, backbone, "Install the package that holds it again.")
    try:
        return Lpips(backbone, weights, head_weights)
    except Exception as error:
        raise _unfit(path, backbone, error, f"Get {BACKBONE_FILES[backbone]} again.") from error


def _tensors(path: Path, backbone: Backbone, fix: str) -> dict[str, Tensor]:
    """Read a file of weights; they are published as .pth only.

    Raises:
        PlopError: The file holds anything but tensors; no code in it is run.
    """
    try:
        found: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise _unfit(path, backbone, error, fix) from error
    return found


def _unfit(path: Path, backbone: Backbone, error: Exception, fix: str) -> PlopError:
    return PlopError(
        "The LPIPS weights cannot be loaded.",
        where=path,
        expected=f"weights of {backbone}, named as in torch's model hub",
        found=_found(error),
        fix=fix,
    )


def _found(error: Exception) -> str:
    """Describe in one line a file that cannot be loaded; torch's own advice, to trust any pickle, is left out."""
    if isinstance(error, UnpicklingError):
        return "not a file of tensors"
    return next(iter(str(error).splitlines()), "") or "an empty or truncated file"


def hub_folder() -> Path:
    """Return the folder in which torch's model hub keeps weights."""
    cache = os.environ.get("XDG_CACHE_HOME", "~/.cache")
    return Path(os.environ.get("TORCH_HOME", f"{cache}/torch")).expanduser() / "hub" / "checkpoints"


def _head_file(backbone: Backbone) -> Path | None:
    inside = {"lpips": "weights/v0.1", "torchmetrics": "functional/image/lpips_models"}
    for package, folder in inside.items():
        found = importlib.util.find_spec(package)
        for root in (found.submodule_search_locations or []) if found else []:
            path = Path(root) / folder / f"{backbone}.pth"
            if path.is_file():
                return path
    return None
