"""Standard splat files: the PLY of 3D Gaussian splatting, read and written.

The PLY has one vertex per Gaussian, binary little endian float32: x y z (metres), nx ny nz (zero),
f_dc_0..2, f_rest_* (colour by colour), opacity as a logit, scale_0..2 as logarithms, rot_0..3 wxyz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.geometry.ply import read_vertices, write_vertices

_OPACITY_MARGIN = 1e-6


def write_splat(path: str | Path, gaussians: Gaussians) -> None:
    """Write Gaussians as a standard splat PLY that public viewers open.

    The file is written atomically. Ids are not part of the format.

    Args:
        path: File to write.
        gaussians: N Gaussians.

    Raises:
        PlopError: A number is not finite, or a scale is not positive.
    """
    columns = _columns(gaussians.detach().to("cpu"))
    table = np.ascontiguousarray(np.concatenate(list(columns.values()), axis=1), dtype="<f4")
    if not np.isfinite(table).all():
        bad = next(name for name, values in columns.items() if not np.isfinite(values).all())
        raise PlopError(
            "Gaussians with a number that is not finite cannot be written.",
            where=path,
            expected="finite numbers, positive scales",
            found=f"NaN or infinity in {bad}",
        )
    names = ["x", "y", "z", "nx", "ny", "nz", *(f"f_dc_{i}" for i in range(3))]
    names += [f"f_rest_{i}" for i in range(columns["f_rest"].shape[1])]
    names += ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    write_vertices(path, table.view([(name, "<f4") for name in names])[:, 0])


def _columns(gaussians: Gaussians) -> dict[str, np.ndarray]:
    """Arrange the fields as the file's columns, each [N, k]."""
    gaussians, count = gaussians.detach().to("cpu"), len(gaussians)
    opacity = gaussians.opacities.double().clamp(_OPACITY_MARGIN, 1 - _OPACITY_MARGIN)
    rest = gaussians.sh[:, 1:].transpose(1, 2).flatten(1)
    columns = {
        "means": gaussians.means,
        "normals": torch.zeros(count, 3),
        "f_dc": gaussians.sh[:, 0],
        "f_rest": rest,
        "opacities": torch.logit(opacity)[:, None],
        "scales": gaussians.scales.double().log(),
        "quats": torch.nn.functional.normalize(gaussians.quats, dim=-1),
    }
    return {name: values.numpy() for name, values in columns.items()}


def read_splat(path: str | Path) -> Gaussians:
    """Read a splat PLY: any order of properties, any number type, binary of either byte order or ASCII.

    Args:
        path: File in the format of this module; normals and f_rest may be absent.

    Returns:
        Gaussians in float32; ids count from 0.

    Raises:
        PlopError: The file is missing, truncated, not a splat PLY, or holds numbers that are not finite.
    """
    path = Path(path)
    table = read_vertices(path)
    names = list(table)
    needed = [
        "x",
        "y",
        "z",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        "opacity",
        "scale_0",
        "scale_1",
        "scale_2",
        "rot_0",
        "rot_1",
        "rot_2",
        "rot_3",
    ]
    missing = [name for name in needed if name not in table]
    if missing:
        raise PlopError(
            "This PLY does not hold Gaussians.",
            where=path,
            expected=", ".join(needed),
            found=f"no {', '.join(missing)}",
            fix="Use a splat PLY, not a point cloud.",
        )
    rest = sorted((n for n in names if n.startswith("f_rest_")), key=lambda n: int(n.removeprefix("f_rest_")))
    terms = 1 + len(rest) // 3
    if len(rest) % 3 or terms not in (1, 4, 9, 16, 25):
        raise PlopError(
            "The colours of this splat PLY are incomplete.",
            where=path,
            expected="0, 9, 24 or 45 properties f_rest_*",
            found=f"{len(rest)}",
        )
    values = {name: np.asarray(table[name], dtype=np.float64) for name in [*needed, *rest]}
    bad = [name for name, column in values.items() if not np.isfinite(column).all()]
    if bad:
        rows = int((~np.isfinite(np.stack([values[n] for n in bad])).all(0)).sum())
        raise PlopError(
            "The splat PLY holds numbers that are not finite.",
            where=path,
            expected="finite numbers",
            found=f"NaN or infinity in {', '.join(bad)} ({rows} Gaussians)",
            fix="Write the file again, or remove these Gaussians.",
        )

    def columns(*keys: str) -> torch.Tensor:
        return torch.from_numpy(np.stack([values[key] for key in keys], axis=-1))

    count = len(values["x"])
    dc = columns("f_dc_0", "f_dc_1", "f_dc_2")[:, None]
    higher = columns(*rest).reshape(count, 3, terms - 1).transpose(1, 2) if rest else dc[:, :0]
    return Gaussians(
        means=columns("x", "y", "z").float(),
        quats=torch.nn.functional.normalize(columns("rot_0", "rot_1", "rot_2", "rot_3"), dim=-1).float(),
        scales=columns("scale_0", "scale_1", "scale_2").exp().float(),
        opacities=torch.sigmoid(torch.from_numpy(values["opacity"])).float(),
        sh=torch.cat([dc, higher], dim=1).float(),
        ids=torch.arange(count),
    )
