"""The animated nodes and the knife in a USD layer of DiSECt, and its declared axes, unit and rate.

The layer is read without composition, so a file cannot refer to another one. Only authored values are used: USD's
defaults (y up, 0.01 m, 24 time codes per second) are not informative about a layer that omits them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.recordings.readers.declared_units import WORLD_FROM_UP

NODES = "/root/particle_instancer.positions"
KNIFE = "/root/body_3"


@dataclass(frozen=True)
class UsdNodes:
    """Content of a layer, in its own axes and units; None where nothing is authored."""

    codes: np.ndarray
    """Time codes of the samples, shape [T], float64."""
    nodes: np.ndarray
    """Shape [T, N, 3]."""
    knife: np.ndarray
    """Positions of the knife, shape [T, 3]."""
    up: str | None
    metres: float | None
    """metersPerUnit [m]."""
    codes_per_second: float | None
    """timeCodesPerSecond, or framesPerSecond where only that is authored, as in USD [1/s]."""
    start_code: float | None
    """startTimeCode."""

    @property
    def declared_by(self) -> str:
        """Names of the authored values, for messages."""
        both = {"upAxis": self.up, "metersPerUnit": self.metres}
        return ", ".join(key for key, value in both.items() if value is not None) or "layer"


def read_usd_nodes(path: Path, *, fix: str) -> UsdNodes:
    """Read a layer.

    Args:
        path: The USD file.
        fix: What to do about a file that is missing or damaged.

    Raises:
        PlopError: usd-core is not installed, the file is missing or damaged, its samples are inconsistent, or its
            declarations are invalid.
    """
    try:
        from pxr import Sdf, Tf
    except ImportError as error:
        raise PlopError(
            "Reading USD files needs usd-core, which is not installed.",
            where=path,
            expected="the package usd-core",
            found=str(error),
            fix='In the folder of plop: pip install -e ".[disect]"',
        ) from error
    damaged = PlopError(
        "The USD file is missing or damaged.",
        where=path,
        expected="a complete USD file",
        found=f"{path.stat().st_size} bytes" if path.is_file() else "no file",
        fix=fix,
    )
    if not path.is_file():
        raise damaged
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
        if layer is None:
            raise damaged
        codes = layer.ListTimeSamplesForPath(NODES)
        if not codes:
            raise PlopError(
                "The USD file contains no simulation nodes over time.",
                where=f"{path}: {NODES}",
                expected="time samples",
                found="none",
                fix="Record with DiSECt's renderer.",
            )
        samples = [np.array(layer.QueryTimeSample(NODES, code), np.float64) for code in codes]
        knife = [layer.QueryTimeSample(f"{KNIFE}.xformOp:translate", code) for code in codes]
        _check_not_moved(layer, path)
        stage = layer.pseudoRoot
        authored = {key: stage.GetInfo(key) for key in stage.ListInfoKeys()}
    except Tf.ErrorException as error:
        raise damaged from error
    if len({sample.shape for sample in samples}) != 1 or any(value is None for value in knife):
        raise PlopError(
            "The samples of the USD file are inconsistent.",
            where=path,
            expected="the same number of nodes in every sample, and the knife in each",
            found=f"{sorted({len(sample) for sample in samples})} nodes, "
            f"{sum(value is None for value in knife)} samples without knife",
            fix="Record this episode again.",
        )
    return UsdNodes(
        np.array(codes, np.float64),
        np.stack(samples),
        np.array([list(value) for value in knife], np.float64),
        _up(authored, path),
        _positive(authored, "metersPerUnit", path),
        _positive(authored, "timeCodesPerSecond", path) or _positive(authored, "framesPerSecond", path),
        float(authored["startTimeCode"]) if "startTimeCode" in authored else None,
    )


def _check_not_moved(layer: Any, path: Path) -> None:
    """Reject a layer whose nodes have a transform of a prim above them: positions are read without transforms."""
    from pxr import Sdf

    prim = layer.GetPrimAtPath(Sdf.Path(NODES).GetPrimPath())
    while prim and prim != layer.pseudoRoot:
        ops = prim.attributes.get("xformOpOrder")
        if ops is not None and ops.default:
            raise PlopError(
                "The nodes of the USD file have a transform of their prim.",
                where=f"{path}: {prim.path}",
                expected="positions in world space, no xformOp above them",
                found=", ".join(ops.default),
                fix="Bake the transform into the positions.",
            )
        prim = prim.nameParent


def _up(authored: dict[str, Any], path: Path) -> str | None:
    if "upAxis" not in authored:
        return None
    up = str(authored["upAxis"]).lower()
    if up not in WORLD_FROM_UP:
        raise PlopError(
            "The USD file declares an invalid up axis.",
            where=f"{path}: upAxis",
            expected="X, Y or Z",
            found=str(authored["upAxis"]),
            fix="Correct the layer.",
        )
    return up


def _positive(authored: dict[str, Any], key: str, path: Path) -> float | None:
    if key not in authored:
        return None
    value = float(authored[key])
    if not 0 < value < np.inf:
        raise PlopError(
            "The USD file declares an invalid unit.",
            where=f"{path}: {key}",
            expected="a positive number",
            found=f"{value:g}",
            fix="Correct the layer.",
        )
    return value
