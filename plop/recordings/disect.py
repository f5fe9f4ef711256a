"""Read what the DiSECt simulator writes: `<name>.usd`, `<name>.npz` and `<name>.json`.

The USD gives the nodes over time, the npz the surface, the tetrahedra and the knife, the JSON
the environment and the parameters. The USD declares neither its up axis nor its unit: y is up
and lengths are metres; both are converted here, and only here, to plop's world (z up). The
layer is read without composing it, so a file can not make this read another one.

Source: NVlabs/DiSECt, `dflex/render.py` and the side file written with each recording.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from plop.errors import PlopError
from plop.installed import install_extra
from plop.recordings.mesh_sequence import MeshSequence, check_mesh_sequence
from plop.recordings.npz_file import Part, read_npz
from plop.recordings.side_file import RawEpisode, check_has_environment, raw_episode, read_side_file

Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Rotation that takes (x, y, z) with y up to (x, -z, y) with z up."""

_NODES = "/root/particle_instancer.positions"
_KNIFE = "/root/body_3"
_WHOLE = "ui"
_ARRAYS = {
    "times": Part((None,)), "knife_position": Part((None, 3)), "knife_quaternion_xyzw": Part((None, 4)),
    "knife_vertices": Part((None, 3)), "knife_faces": Part((None, 3), _WHOLE), "points_rest": Part((None, 3)),
    "tets": Part((None, 4), _WHOLE), "surface_clean": Part((None, 3), _WHOLE),
    "cut_edge_indices": Part((None, 2), _WHOLE), "cut_edge_coords": Part((None,)),
    "virtual_nodes": Part((None,), _WHOLE),
}  # fmt: skip
_MAY_BE_EMPTY = ("cut_edge_indices", "cut_edge_coords", "virtual_nodes")
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
        raise PlopError("There are no DiSECt recordings here.", where=folder, expected="<name>.usd, .npz and .json",
                        found="no .usd file", fix="Give the folder that holds the .usd files.")  # fmt: skip
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
    times, nodes, usd_knife = _read_usd(path)
    _check_against_side_file(path, arrays, times, nodes, usd_knife)
    rest = arrays["points_rest"].astype(np.float64)
    used, faces = np.unique(arrays["surface_clean"], return_inverse=True)
    virtual = np.isin(np.arange(len(rest)), arrays["virtual_nodes"])
    sequence = MeshSequence(
        name=path.stem,
        environment=side["environment"],
        source="disect",
        times=times,
        vertices=_z_up(_with_cut_vertices(nodes, arrays)[:, used]),
        faces=faces.reshape(-1, 3).astype(np.int64),
        rest_vertices=_z_up(_with_cut_vertices(rest, arrays)[used]),
        cut_faces=arrays["surface_clean"].min(axis=1) >= len(rest),
        tool_vertices=_z_up(arrays["knife_vertices"].astype(np.float64)),
        tool_faces=arrays["knife_faces"].astype(np.int64),
        world_from_tool=_knife_poses(arrays["knife_position"], arrays["knife_quaternion_xyzw"]),
        table_z_m=0.0 if side.get("settings", {}).get("ground", True) else None,
        truth={
            "nodes_m": _z_up(nodes).astype(np.float32),
            "rest_nodes_m": _z_up(rest).astype(np.float32),
            "node_is_real": ~virtual,
            "tets": arrays["tets"].astype(np.int64),
        },
        facts=side,
    )
    check_mesh_sequence(sequence, path)
    return sequence


def _with_cut_vertices(points: np.ndarray, arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Append the points where the cut crosses edges, [..., N, 3] -> [..., N + C, 3]."""
    start, end = (points[..., arrays["cut_edge_indices"][:, side], :] for side in (0, 1))
    share = arrays["cut_edge_coords"].astype(np.float64)[:, None]
    return np.concatenate([points, start * (1 - share) + end * share], axis=-2)


def _z_up(points: np.ndarray) -> np.ndarray:
    return points @ Z_UP_FROM_Y_UP.T


def _knife_poses(position: np.ndarray, quaternion_xyzw: np.ndarray) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(position), 1, 1))
    rotation = Rotation.from_quat(quaternion_xyzw.astype(np.float64)).as_matrix()
    poses[:, :3, :3] = Z_UP_FROM_Y_UP @ rotation @ Z_UP_FROM_Y_UP.T
    poses[:, :3, 3] = _z_up(position.astype(np.float64))
    return poses


def _read_side(path: Path) -> dict[str, Any]:
    texts = dict.fromkeys(("environment", "shape", "material"), str)
    side = read_side_file(path, {**texts, "units": dict, "settings": dict}, fix=_COPY_AGAIN)
    if "environment" not in side and {"shape", "material"} <= side.keys():  # a recording that hides its settings
        side["environment"] = f"{side['shape']}-{side['material']}"
    check_has_environment(side, path, fix=_COPY_AGAIN)
    units = side.get("units", {})
    if (units.get("length", "m"), units.get("up", "y")) != ("m", "y"):
        raise PlopError("The recording has other units.", where=path, expected="metres, y up",
                        found=f"{units.get('length')}, {units.get('up')} up",
                        fix="Convert the recording to metres with y up.")  # fmt: skip
    return side


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    arrays = read_npz(path, _ARRAYS, may_be_empty=_MAY_BE_EMPTY, fix=_COPY_AGAIN)
    arrays = {key: arrays[key] for key in _ARRAYS}
    for key, value in arrays.items():
        if not np.isfinite(value).all():
            raise PlopError("The recording holds NaN or infinite values.", where=f"{path}: {key}",
                            expected="finite numbers", found=f"{int((~np.isfinite(value)).sum())} others",
                            fix="Simulate it again or leave it out.")  # fmt: skip
    key = "knife_quaternion_xyzw"
    zero = np.linalg.norm(arrays[key], axis=-1) < _LEAST_QUATERNION
    if zero.any():
        raise PlopError("An orientation of the knife is no quaternion.", where=f"{path}: {key}",
                        expected="four numbers, not all zero",
                        found=f"zero in {int(zero.sum())} of {zero.size} frames, the first is {int(np.argmax(zero))}",
                        fix="Simulate it again or leave it out.")  # fmt: skip
    return arrays


def _read_usd(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read times [T] s, nodes [T, N, 3] and knife positions [T, 3], metres with y up."""
    try:
        from pxr import Sdf, Tf
    except ImportError as error:
        raise PlopError("Reading USD files needs usd-core, which is not installed.", where=path,
                        expected="the package usd-core", found=str(error),
                        fix=install_extra("disect") + ".") from error  # fmt: skip
    damaged = PlopError("The USD file is missing or damaged.", where=path, expected="a complete USD file",
                        found=f"{path.stat().st_size} bytes" if path.is_file() else "no file",
                        fix=_COPY_AGAIN)  # fmt: skip
    if not path.is_file():
        raise damaged
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
        if layer is None:
            raise damaged
        times = layer.ListTimeSamplesForPath(_NODES)
        if not times:
            raise PlopError("The USD file holds no simulation nodes over time.", where=f"{path}: {_NODES}",
                            expected="time samples", found="none", fix="Record with DiSECt's renderer.")  # fmt: skip
        samples = [np.array(layer.QueryTimeSample(_NODES, time), np.float64) for time in times]
        knife = [layer.QueryTimeSample(f"{_KNIFE}.xformOp:translate", time) for time in times]
    except Tf.ErrorException as error:
        raise damaged from error
    if len({sample.shape for sample in samples}) != 1 or any(value is None for value in knife):
        raise PlopError("The samples of the USD file do not fit together.", where=path,
                        expected="as many nodes in every sample, and the knife in each",
                        found=f"{sorted({len(sample) for sample in samples})} nodes, "
                              f"{sum(value is None for value in knife)} samples without knife",
                        fix="Record this episode again.")  # fmt: skip
    return np.array(times, np.float64), np.stack(samples), np.array([list(value) for value in knife], np.float64)


def _check_against_side_file(
    path: Path, arrays: dict[str, np.ndarray], times: np.ndarray, nodes: np.ndarray, knife: np.ndarray
) -> None:
    def refuse(what: str, expected: str, found: str) -> None:
        raise PlopError("The recording's USD and npz files do not belong together.", where=f"{path}: {what}",
                        expected=f"{expected}, as in the npz", found=f"{found} in the USD",
                        fix="Copy .usd, .npz and .json of the same recording.")  # fmt: skip

    if len(times) != len(arrays["times"]) or np.abs(times - arrays["times"]).max() > _SAME_TIME_S:
        refuse("time samples", f"{len(arrays['times'])} up to {arrays['times'][-1]:g} s",
               f"{len(times)} up to {times[-1]:g} s")  # fmt: skip
    for key in ("knife_position", "knife_quaternion_xyzw"):
        if len(arrays[key]) != len(times):
            refuse(key, f"{len(arrays[key])} poses", f"{len(times)} frames")
    if nodes.shape[1] != len(arrays["points_rest"]):
        refuse("nodes", f"{len(arrays['points_rest'])} nodes", f"{nodes.shape[1]} nodes")
    if not np.isfinite(nodes).all():
        raise PlopError("The recording holds NaN or infinite node positions.", where=f"{path}: {_NODES}",
                        expected="finite metres", found=f"{int((~np.isfinite(nodes)).sum())} others",
                        fix="The simulation blew up: simulate it again or leave it out.")  # fmt: skip
    gap = float(np.abs(knife - arrays["knife_position"]).max())
    if gap > _SAME_PLACE_M:
        refuse("knife", "the knife at the same place", f"up to {gap:.4f} m away")
    vertices = len(arrays["points_rest"]) + len(arrays["cut_edge_indices"])
    edges = arrays["cut_edge_indices"]
    if edges.min(initial=0) < 0 or edges.max(initial=0) >= len(arrays["points_rest"]):
        refuse("cut_edge_indices", f"indices 0..{len(arrays['points_rest']) - 1}", f"{edges.min()}..{edges.max()}")
    surface = arrays["surface_clean"]
    if len(arrays["cut_edge_coords"]) != len(edges) or surface.min() < 0 or surface.max() >= vertices:
        refuse("surface_clean", f"indices 0..{vertices - 1}", f"{surface.min()}..{surface.max()}")
