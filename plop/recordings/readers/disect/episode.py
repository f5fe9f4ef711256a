"""Read recordings of the DiSECt simulator: `<name>.usd`, `<name>.npz` and `<name>.json`.

The USD gives the nodes over time, the npz the surface, the tetrahedra and the knife, the JSON
the environment and the parameters. DiSECt's own USD declares neither its up axis nor its unit: y is
up, lengths are metres and a time code is a second. Declarations in a layer or the JSON are used
(upAxis, metersPerUnit, timeCodesPerSecond; `units`), for both the USD and the npz. Everything is converted
here, and only here, to plop's world (z up).

Source: NVlabs/DiSECt, `dflex/render.py` and the side file written with each recording.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.recordings.array_checks import Part
from plop.recordings.readers.declared_units import (
    WORLD_FROM_UP,
    Declared,
    WorldFrame,
    declared_in_side_file,
    seconds_from,
    together,
)
from plop.recordings.readers.disect.usd_nodes import NODES, UsdNodes, read_usd_nodes
from plop.recordings.readers.mesh.npz_file import check_finite, read_npz
from plop.recordings.readers.mesh.sequence import MeshSequence, check_mesh_sequence
from plop.recordings.readers.side_file import RawEpisode, check_has_environment, raw_episode, read_side_file

_WHOLE = "ui"
_ARRAYS = {
    "times": Part((None,)),
    "knife_position": Part((None, 3)),
    "knife_quaternion_xyzw": Part((None, 4)),
    "knife_vertices": Part((None, 3)),
    "knife_faces": Part((None, 3), _WHOLE),
    "points_rest": Part((None, 3)),
    "tets": Part((None, 4), _WHOLE),
    "surface_clean": Part((None, 3), _WHOLE),
    "cut_edge_indices": Part((None, 2), _WHOLE),
    "cut_edge_coords": Part((None,)),
    "virtual_nodes": Part((None,), _WHOLE),
}
_MAY_BE_EMPTY = ("cut_edge_indices", "cut_edge_coords", "virtual_nodes")
_UP, _METRES = "y", 1.0
"""Default axes and units of DiSECt's recordings."""
_SAME_TIME_S = 1e-4
_SAME_PLACE_M = 1e-4
_LEAST_QUATERNION = 1e-6
_COPY_AGAIN = "Copy this recording again: .usd, .npz and .json belong together."


def list_disect(folder: Path) -> list[RawEpisode]:
    """List the recordings of a folder by name, reading only their JSON files.

    Raises:
        PlopError: There are none.
    """
    names = sorted({path.stem for kind in ("*.usd", "*.npz") for path in folder.glob(kind)})
    if not names:
        raise PlopError(
            "There are no DiSECt recordings here.",
            where=folder,
            expected="<name>.usd, .npz and .json",
            found="no .usd file",
            fix="Give the folder that contains the .usd files.",
        )
    return [raw_episode(folder / f"{name}.usd", _read_side, _guess_environment) for name in names]


def _guess_environment(name: str) -> str:
    return re.sub(r"(_part)?_\d+$", "", name).replace("_", "-")


def read_disect(path: str | Path) -> MeshSequence:
    """Read one recording.

    Args:
        path: Path of the USD file; the npz and the JSON lie beside it.

    Returns:
        The episode with z up, in metres. Its vertices are those that the watertight surface uses;
        `truth` holds nodes_m [T, N, 3], rest_nodes_m [N, 3], node_is_real [N] and tets [M, 4].

    Raises:
        PlopError: A file is missing, truncated or holds NaN, or the files contradict each other.
    """
    path = Path(path)
    side, arrays = _read_side(path.with_suffix(".json")), _read_arrays(path.with_suffix(".npz"))
    usd = read_usd_nodes(path, fix=_COPY_AGAIN)
    in_side = declared_in_side_file(side, path.with_suffix(".json"))
    said = together(Declared(f"{path}: {usd.declared_by}", usd.up, usd.metres), replace(in_side, seconds=None))
    frame = WorldFrame(said.up or _UP, said.metres or _METRES)
    nodes = frame.points(usd.nodes)
    times, notes, timed = _times(path, usd, arrays["times"], in_side)
    _check_against_side_file(path, arrays, usd, frame)
    rest = frame.points(arrays["points_rest"].astype(np.float64))
    used, faces = np.unique(arrays["surface_clean"], return_inverse=True)
    virtual = np.isin(np.arange(len(rest)), arrays["virtual_nodes"])
    sequence = MeshSequence(
        name=path.stem,
        environment=side["environment"],
        source="disect",
        times=times,
        vertices=_with_cut_vertices(nodes, arrays)[:, used],
        faces=faces.reshape(-1, 3).astype(np.int64),
        rest_vertices=_with_cut_vertices(rest, arrays)[used],
        cut_faces=arrays["surface_clean"].min(axis=1) >= len(rest),
        tool_vertices=frame.points(arrays["knife_vertices"].astype(np.float64)),
        tool_faces=arrays["knife_faces"].astype(np.int64),
        world_from_tool=_knife_poses(arrays["knife_position"], arrays["knife_quaternion_xyzw"], frame),
        table_z_m=0.0 if side.get("settings", {}).get("ground", True) else None,
        truth={
            "nodes_m": nodes.astype(np.float32),
            "rest_nodes_m": rest.astype(np.float32),
            "node_is_real": ~virtual,
            "tets": arrays["tets"].astype(np.int64),
        },
        facts=side,
        up=frame.up,
        declared=said.said | ({"time"} if timed else frozenset()),
        notes=tuple(notes),
    )
    check_mesh_sequence(sequence, path)
    return sequence


def _times(path: Path, usd: UsdNodes, npz_times: np.ndarray, in_side: Declared) -> tuple[np.ndarray, list[str], bool]:
    """Combine the time codes and the npz's `times`.

    Returns:
        Seconds [T], notes, and whether the files declare their unit.
    """
    where = f"{path}: time samples"
    if len(usd.codes) != len(npz_times):
        raise _refusal(
            path,
            "time samples",
            f"{len(npz_times)} up to {npz_times[-1]:g}",
            f"{len(usd.codes)} up to {usd.codes[-1]:g}",
        )
    stored, notes = seconds_from(npz_times, in_side.seconds or 1.0)
    rate = usd.codes_per_second or 1.0
    for start in dict.fromkeys((0.0, usd.start_code or 0.0)):
        times = (usd.codes - start) / rate
        if np.abs(times - stored).max() <= _SAME_TIME_S:
            return times, notes, in_side.seconds is not None or usd.codes_per_second not in (None, 1.0)
    whole = bool((usd.codes == np.round(usd.codes)).all())
    same = bool(np.abs(usd.codes - npz_times).max() <= _SAME_TIME_S)
    if same and in_side.seconds is not None and usd.codes_per_second is None:
        return stored, notes, True
    if same and whole and in_side.seconds is None and usd.codes_per_second is not None:
        return (
            (usd.codes - (usd.start_code or 0.0)) / rate,
            [f"the npz has time codes, not seconds: they are divided by timeCodesPerSecond = {rate:g} of the layer"],
            True,
        )
    span, stored_span = float(np.ptp(usd.codes)), float(np.ptp(stored))
    shares = [(times - times[0]) / length for times, length in ((usd.codes, span), (stored, stored_span)) if length > 0]
    steady = len(shares) == 2 and float(np.abs(shares[0] - shares[1]).max()) < 1e-3
    said = (
        f"timeCodesPerSecond = {rate:g}"
        if usd.codes_per_second is not None
        else "no timeCodesPerSecond, assumed to be 1"
    )
    raise PlopError(
        "The times of the recording's USD and npz files differ.",
        where=where,
        expected=f"{stored[0]:g} to {stored[-1]:g} s, as in the npz"
        + (f" with {in_side.source}" if in_side.seconds is not None else ""),
        found=f"{usd.codes[0] / rate:g} to {usd.codes[-1] / rate:g} s in the USD: time codes "
        f"{usd.codes[0]:g} to {usd.codes[-1]:g}, {said}",
        fix=f"If the npz is right there are {span / stored_span:g} time codes per second: write that as the "
        "layer's timeCodesPerSecond; otherwise correct `times`, or declare their unit in the JSON "
        '("units": {"time": "ms"} or {"frames_per_second": 30}).'
        if steady
        else _COPY_AGAIN,
    )


def _with_cut_vertices(points: np.ndarray, arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Append the points where the cut crosses edges, [..., N, 3] -> [..., N + C, 3]."""
    start, end = (points[..., arrays["cut_edge_indices"][:, side], :] for side in (0, 1))
    share = arrays["cut_edge_coords"].astype(np.float64)[:, None]
    return np.concatenate([points, start * (1 - share) + end * share], axis=-2)


def _knife_poses(position: np.ndarray, quaternion_xyzw: np.ndarray, frame: WorldFrame) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(position), 1, 1))
    poses[:, :3, :3] = frame.rotations(Rotation.from_quat(quaternion_xyzw.astype(np.float64)).as_matrix())
    poses[:, :3, 3] = frame.points(position.astype(np.float64))
    return poses


def _read_side(path: Path) -> dict[str, Any]:
    texts = dict.fromkeys(("environment", "shape", "material"), str)
    side = read_side_file(path, {**texts, "units": dict, "settings": dict}, fix=_COPY_AGAIN)
    if "environment" not in side and {"shape", "material"} <= side.keys():  # a recording without its settings
        side["environment"] = f"{side['shape']}-{side['material']}"
    check_has_environment(side, path, fix=_COPY_AGAIN)
    return side


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    arrays = read_npz(path, _ARRAYS, may_be_empty=_MAY_BE_EMPTY, fix=_COPY_AGAIN)
    arrays = {key: arrays[key] for key in _ARRAYS}
    for key, value in arrays.items():
        check_finite(value, f"{path}: {key}")
    key = "knife_quaternion_xyzw"
    zero = np.linalg.norm(arrays[key], axis=-1) < _LEAST_QUATERNION
    if zero.any():
        raise PlopError(
            "An orientation of the knife is not a quaternion.",
            where=f"{path}: {key}",
            expected="four numbers, not all zero",
            found=f"zero in {int(zero.sum())} of {zero.size} frames, the first is {int(np.argmax(zero))}",
            fix="Simulate it again or leave it out.",
        )
    return arrays


def _refusal(path: Path, what: str, expected: str, found: str, fix: str | None = None) -> PlopError:
    return PlopError(
        "The recording's USD and npz files do not belong together.",
        where=f"{path}: {what}",
        expected=f"{expected}, as in the npz",
        found=f"{found} in the USD",
        fix=fix or "Copy .usd, .npz and .json of the same recording.",
    )


def _check_against_side_file(path: Path, arrays: dict[str, np.ndarray], usd: UsdNodes, frame: WorldFrame) -> None:
    nodes, count = usd.nodes, len(arrays["points_rest"])
    for key in ("knife_position", "knife_quaternion_xyzw"):
        if len(arrays[key]) != len(nodes):
            raise _refusal(path, key, f"{len(arrays[key])} poses", f"{len(nodes)} frames")
    if nodes.shape[1] != count:
        raise _refusal(path, "nodes", f"{count} nodes", f"{nodes.shape[1]} nodes")
    check_finite(nodes, f"{path}: {NODES}")
    gap = float(np.abs(usd.knife - arrays["knife_position"]).max()) * frame.metres
    if gap > _SAME_PLACE_M:
        raise _refusal(
            path,
            "knife",
            "the knife at the same position",
            f"up to {gap:.4f} m away",
            _other_frame(usd.knife, arrays["knife_position"].astype(np.float64)),
        )
    edges, vertices = arrays["cut_edge_indices"], count + len(arrays["cut_edge_indices"])
    if edges.min(initial=0) < 0 or edges.max(initial=0) >= count:
        raise _refusal(path, "cut_edge_indices", f"indices 0..{count - 1}", f"{edges.min()}..{edges.max()}")
    surface = arrays["surface_clean"]
    if len(arrays["cut_edge_coords"]) != len(edges) or surface.min() < 0 or surface.max() >= vertices:
        raise _refusal(path, "surface_clean", f"indices 0..{vertices - 1}", f"{surface.min()}..{surface.max()}")


def _other_frame(in_usd: np.ndarray, in_npz: np.ndarray) -> str | None:
    """Return what would make two tracks of the knife agree: another unit, or other axes; None when neither does."""
    length = float(np.linalg.norm(in_npz))
    factor = float(np.linalg.norm(in_usd)) / length if length > 0 else 1.0
    for turn in WORLD_FROM_UP.values():
        for other in (turn, WORLD_FROM_UP[_UP].T @ turn):
            if np.abs(in_usd - factor * in_npz @ other.T).max() <= 1e-3 * np.abs(in_usd).max():
                unit = f"numbers {factor:.4g} times those of the npz" if abs(factor - 1) > 1e-3 else ""
                axes = "" if np.allclose(other, np.eye(3)) else "other axes than the npz"
                return (
                    f"The USD has {' and '.join(filter(None, (unit, axes)))}: write both in the unit and axes that "
                    "the layer or the JSON declares."
                )
    return None
