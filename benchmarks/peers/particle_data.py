"""Particle rollouts in the layout of DPI-Net's data, repacked: FOLDER/ENVIRONMENT/*.npz, one rollout a file.

    positions   (T, N, D) float, y up [m]; of 6 columns the first three are the rest position
    shape_quats (T, S, 4), where there are S moving shapes: the last S rows of the positions

The published files of DPI-Net (github.com/YunzhuLi/DPI-Net) have no licence: they are read, never copied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from plop.errors import PlopError

RADIUS_M = 0.08
"""DPI-Net's radius of neighbourhoods [m]."""
FEATURES = 23
"""Numbers that describe a particle, as many as I2N reads; unused ones are 0."""
_FAR = 4.0
"""Largest distance from a shape that a particle feels, in radii."""
RIGID = {"BoxBath": 64}
"""First particles that form one rigid body, by environment."""
SAME_SCENE = {"RiceGrip": ("valid_0", "valid_1")}
"""Rollouts of which one continues the other: never on both sides of a split."""
_WALLS = 5
"""FluidShake's shapes: floor, left, right, back, front."""


@dataclass(frozen=True)
class ParticleRollout:
    """One simulated rollout."""

    name: str
    positions: Tensor
    """Positions of the particles, shape [T, N, 3] [m]."""
    rest: Tensor | None
    """Rest positions, shape [N, 3] [m], where the data have them."""
    shapes: Tensor
    """Positions of moving shapes, which are given, shape [T, S, 3] [m]."""
    rigid: int
    """First particles that form one rigid body."""

    def __len__(self) -> int:
        return len(self.positions)

    def to(self, device: str) -> ParticleRollout:
        """Copy it to a device."""
        rest = None if self.rest is None else self.rest.to(device)
        return replace(self, positions=self.positions.to(device), rest=rest, shapes=self.shapes.to(device))

    def features(self, frame: int, now: Tensor, before: Tensor, motion_m: float) -> Tensor:
        """Describe every particle at a frame: its kind, motion, rest position, and where the shapes are.

        Args:
            frame: The frame from which a step starts; the shapes' motion in this step is known.
            now: Positions, shape [N, 3] [m].
            before: Positions one frame earlier.
            motion_m: Unit of motions [m].

        Returns:
            Shape [N, FEATURES].
        """
        kind = now.new_zeros(len(now), 2)
        kind[: self.rigid, 0] = 1
        kind[self.rigid :, 1] = 1
        columns = [kind, (now - before) / motion_m, (now[:, 1:2] / RADIUS_M).clamp(-_FAR, _FAR)]
        if self.rest is not None:
            columns.append((now - self.rest) / RADIUS_M)
        columns += self._of_shapes(frame, now, motion_m)
        known = torch.cat(columns, dim=1)
        return torch.nn.functional.pad(known, (0, FEATURES - known.shape[1]))

    def _of_shapes(self, frame: int, now: Tensor, motion_m: float) -> list[Tensor]:
        shapes = self.shapes[frame]
        if len(shapes) == 0:
            return []
        moved = (self.shapes[min(frame + 1, len(self) - 1)] - shapes) / motion_m
        if len(shapes) == _WALLS:
            axes, signs = [1, 0, 0, 2, 2], now.new_tensor([1.0, 1, -1, 1, -1])
            apart = (now[:, axes] - shapes[range(_WALLS), axes]) * signs / RADIUS_M
            return [apart.clamp(-_FAR, _FAR), moved[1].expand(len(now), 3)]
        apart = ((now[:, None] - shapes) / RADIUS_M).clamp(-_FAR, _FAR).flatten(1)
        return [apart[:, : FEATURES - 15], moved.flatten().expand(len(now), -1)[:, :6]]


def read_rollouts(folder: Path, environment: str) -> list[ParticleRollout]:
    """Read the rollouts of an environment.

    Raises:
        PlopError: No such environment, fewer than three rollouts, or a file without positions.
    """
    paths = sorted(path for path in (folder / environment).glob("*.npz") if path.stem != "stat")
    if len(paths) < 3:
        known = sorted(path.name for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
        raise PlopError(
            "There are too few rollouts to train, choose and test on.",
            where=folder / environment,
            expected=f"at least 3 files *.npz; environments here: {', '.join(known) or 'none'}",
            found=str(len(paths)),
            fix="Name the folder of the particle data with --data.",
        )
    return [_read(path, environment) for path in paths]


def _read(path: Path, environment: str) -> ParticleRollout:
    expected = "finite positions (T, N, 3 or 6), T at least 4, and perhaps shape_quats (T, S, 4)"
    try:
        with np.load(path, allow_pickle=False) as file:
            places = np.asarray(file["positions"], np.float32)
            shapes = file["shape_quats"].shape[1] if "shape_quats" in file else 0
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise PlopError(
            "A rollout cannot be read.", where=path, expected=expected, found=str(error), fix="Pack the data again."
        ) from error
    if places.ndim != 3 or places.shape[2] not in (3, 6) or len(places) < 4 or not np.isfinite(places).all():
        found = str(places.shape) if np.isfinite(places).all() else "numbers that are not finite"
        raise PlopError(
            "A rollout has positions of another form.",
            where=path,
            expected=expected,
            found=found,
            fix="Pack the data again, or leave the file out.",
        )
    skip = 1 if places.shape[2] == 6 else 0  # RiceGrip's frame 0 is from before the solver's first step
    everything = torch.from_numpy(places[skip:, :, -3:].copy())
    count = everything.shape[1] - shapes
    rest = torch.from_numpy(places[skip, :count, :3].copy()) if places.shape[2] == 6 else None
    return ParticleRollout(path.stem, everything[:, :count], rest, everything[:, count:], RIGID.get(environment, 0))
