"""Simulated episodes with other axes, units, rates and surfaces than plop's own (`ingest mesh`, `ingest disect`)."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.recording import Recording
from plop.recordings.truth import Truth
from tests.cases.case import Case, Done
from tests.recordings import disect_sample

_SMALL = "--cameras.size 24 --cameras.count 2 --set cameras.supersample=1"
_MESH, _DISECT = f"ingest mesh raw {_SMALL}", f"ingest disect raw {_SMALL}"
_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
_SIZE_M = np.array([0.10, 0.06, 0.05])


def _block(frames: int = 5) -> MeshSequence:
    """A soft block on a table that a blade dents."""
    box = trimesh.creation.box(_SIZE_M).subdivide()
    rest = np.asarray(box.vertices) + [0, 0, _SIZE_M[2] / 2]
    blade = trimesh.creation.box([0.004, 0.09, 0.04])
    vertices, poses = np.tile(rest, (frames, 1, 1)), np.tile(np.eye(4), (frames, 1, 1))
    for frame in range(frames):
        tip = _SIZE_M[2] + 0.004 - 0.002 * frame
        dent = max(0, _SIZE_M[2] - tip) * np.exp(-((rest[:, 0] / 0.012) ** 2))
        vertices[frame, :, 2] -= dent * rest[:, 2] / _SIZE_M[2]
        poses[frame, 2, 3] = tip + 0.02
    return MeshSequence(
        "block_000",
        "block",
        np.arange(frames) / 30,
        vertices,
        np.asarray(box.faces),
        np.asarray(blade.vertices),
        np.asarray(blade.faces),
        poses,
    )


def _write(change: Callable[[dict[str, Any]], object] = lambda arrays: None, **side: Any) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        block = _block()
        keys = ("times", "vertices", "faces", "tool_vertices", "tool_faces", "world_from_tool")
        arrays: dict[str, Any] = {key: getattr(block, key).copy() for key in keys}
        change(arrays)
        (folder / "raw").mkdir()
        for name in ("block_000", "block_001"):
            np.savez(folder / "raw" / f"{name}.npz", **arrays)
            (folder / "raw" / f"{name}.json").write_text(json.dumps({"environment": "block", "table_z_m": 0.0, **side}))

    return make


def _turn(arrays: dict[str, Any]) -> None:
    for key in ("vertices", "tool_vertices"):
        arrays[key] = arrays[key] @ _Y_UP.T
    poses = arrays["world_from_tool"]
    poses[:, :3, :3], poses[:, :3, 3] = _Y_UP @ poses[:, :3, :3] @ _Y_UP.T, poses[:, :3, 3] @ _Y_UP.T


def _scale(factor: float) -> Callable[[dict[str, Any]], None]:
    def change(arrays: dict[str, Any]) -> None:
        for key in ("vertices", "tool_vertices"):
            arrays[key] = arrays[key] * factor
        arrays["world_from_tool"][:, :3, 3] *= factor

    return change


def _reorder(arrays: dict[str, Any]) -> None:
    order = np.random.default_rng(0).permutation(arrays["vertices"].shape[1])
    arrays["vertices"][3:] = arrays["vertices"][3:][:, order]


def _soup(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return vertices[faces].reshape(-1, 3).copy(), np.arange(faces.size).reshape(-1, 3)


def _zeroed_tool(arrays: dict[str, Any]) -> None:
    vertices, faces = _soup(arrays["tool_vertices"] + [0, 0, 0.05], arrays["tool_faces"])
    vertices[9:15] = 0
    arrays |= {"tool_vertices": vertices, "tool_faces": faces}


def _soup_tool(arrays: dict[str, Any]) -> None:
    vertices, faces = _soup(arrays["tool_vertices"], arrays["tool_faces"])
    arrays |= {"tool_vertices": vertices, "tool_faces": faces}


def _open_below(arrays: dict[str, Any]) -> None:
    low = (arrays["vertices"][0][arrays["faces"]][..., 2] < 1e-6).all(1)
    arrays["faces"] = arrays["faces"][~low]


def _is_the_block(done: Done) -> None:
    for path in (done.workspace / "artifacts" / "ingest").glob("*/episodes/*.h5"):
        with Truth(path) as truth, Recording(path) as recording:
            surface = truth.surface(0)
            np.testing.assert_allclose(np.ptp(surface.vertices, axis=0), _SIZE_M, atol=1e-5)
            np.testing.assert_allclose(surface.vertices[:, 2].min(), 0, atol=1e-5)
            assert trimesh.Trimesh(surface.vertices, surface.faces, process=False).volume > 0
            np.testing.assert_allclose(recording.time_s, np.arange(5) / 30, atol=1e-6)
            np.testing.assert_allclose(recording.world_from_tool[0], _block().world_from_tool[0], atol=1e-5)


_FROM_Z = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
_USD_TIMES = np.arange(1, 4) / 30


def _usd(
    *,
    turn: np.ndarray | None = None,
    scale: float = 1.0,
    codes: np.ndarray = _USD_TIMES,
    times: np.ndarray = _USD_TIMES,
    units: dict[str, Any] | None = None,
    **layer: Any,
) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        from pxr import Sdf

        def placed(points: np.ndarray) -> np.ndarray:
            return (points @ (np.eye(3) if turn is None else turn).T * scale).astype(np.float32)

        (folder / "raw").mkdir()
        arrays = disect_sample.side_arrays() | {"times": times}
        arrays |= {key: placed(arrays[key]) for key in ("knife_position", "knife_vertices", "points_rest")}
        for name in ("pyramid_jelly_000", "pyramid_jelly_001"):
            nodes, knife = placed(disect_sample.node_positions()), placed(disect_sample.knife_positions())
            path = disect_sample.write_sample(
                folder / "raw", name, nodes=nodes, knife=knife, times=codes, arrays=arrays
            )
            written = Sdf.Layer.FindOrOpen(str(path))
            for key, value in layer.items():
                written.pseudoRoot.SetInfo(key, value)
            written.Save()
            side = json.loads(path.with_suffix(".json").read_text())
            del side["units"]
            path.with_suffix(".json").write_text(json.dumps(side | ({"units": units} if units else {})))

    return make


def _is_the_pyramid(done: Done) -> None:
    for path in (done.workspace / "artifacts" / "ingest").glob("*/episodes/*.h5"):
        with Truth(path) as truth, Recording(path) as recording:
            np.testing.assert_allclose(np.ptp(truth.surface(0).vertices, axis=0), [0.04, 0.04, 0.03], atol=1e-5)
            np.testing.assert_allclose(truth.surface(0).vertices[:, 2].min(), 0, atol=1e-6)
            np.testing.assert_allclose(recording.world_from_tool[0, :3, 3], [0.003, 0, 0.06], atol=1e-5)
            np.testing.assert_allclose(recording.time_s, _USD_TIMES, atol=1e-6)


_CLOSED = ("clockwise", "not closed", "is damaged")
_OF_MESHES = [
    Case("mesh control", "own", _write(), (_MESH,), never=_CLOSED, right=_is_the_block),
    Case(
        "mesh y up",
        "trifinger_simulation#38, IfcOpenShell#1155",
        _write(_turn),
        (_MESH,),
        refused=("up axis seems to be wrong", "y up it is on the table", '"up": "y"'),
    ),
    Case(
        "mesh y up, stated", "trifinger_simulation#38", _write(_turn, units={"up": "y"}), (_MESH,), right=_is_the_block
    ),
    Case(
        "mesh ten times too large",
        "Autodesk/maya-usd#932",
        _write(_scale(10)),
        (_MESH,),
        refused=("implausible size", "decimetres", '"length"'),
    ),
    Case(
        "mesh in millimetres",
        "Autodesk/maya-usd#932",
        _write(_scale(1000)),
        (_MESH,),
        refused=("implausible size", "millimetres", '"length": "mm"'),
    ),
    Case(
        "mesh in millimetres, stated",
        "Autodesk/maya-usd#932",
        _write(_scale(1000), units={"length": "mm"}),
        (_MESH,),
        right=_is_the_block,
    ),
    Case(
        "mesh ten times too small",
        "Autodesk/maya-usd#932",
        _write(_scale(0.1)),
        (_MESH,),
        refused=("implausible size", "10 times too small"),
    ),
    Case(
        "mesh half in its table", "own", _write(table_z_m=0.025), (_MESH,), refused=("partly in its table", "table_z_m")
    ),
    Case("mesh pressed into its table by 2 mm", "own", _write(table_z_m=0.002), (_MESH,)),
    Case("mesh above its table", "own", _write(table_z_m=-0.2), (_MESH,), warned=("floats 200 mm", "table_z_m")),
    Case(
        "mesh times are frame numbers",
        "OpenUSD#3513",
        _write(lambda a: a.update(times=np.arange(5))),
        (_MESH,),
        refused=("frame numbers", "frames_per_second"),
    ),
    Case(
        "mesh times are frame numbers, stated",
        "OpenUSD#3513",
        _write(lambda a: a.update(times=np.arange(5)), units={"frames_per_second": 30}),
        (_MESH,),
        right=_is_the_block,
    ),
    Case(
        "mesh times in milliseconds of fast frames",
        "OpenLORIS-Scene#28",
        _write(
            lambda a: a.update(
                times=np.arange(5) * 0.5,
                world_from_tool=a["world_from_tool"][[0, 0, 0, 0, 0]],
                vertices=a["vertices"][[0] * 5] - np.arange(5)[:, None, None] * [0, 0, 2e-5],
            )
        ),
        (_MESH + " --set keep_untouched=true",),
        refused=("too slowly", "milliseconds", '"time": "ms"'),
    ),
    Case(
        "mesh times in nanoseconds",
        "chutsu/rs4se#1",
        _write(lambda a: a.update(times=np.arange(5) * 33_333_333)),
        (_MESH,),
        refused=("nanoseconds", '"time": "ns"'),
    ),
    Case(
        "mesh times a thousand times too short",
        "own",
        _write(lambda a: a.update(times=a["times"] / 1000)),
        (_MESH,),
        refused=("too fast", "multiply them by 1000"),
    ),
    Case(
        "mesh vertex order changes",
        "mikedh/trimesh#1069",
        _write(_reorder),
        (_MESH,),
        refused=("order of the vertices changes", "frame 3"),
    ),
    Case(
        "mesh vertices set to zero",
        "own",
        _write(lambda a: a["vertices"][2, 3:9].fill(0)),
        (_MESH,),
        refused=("coincide", "frame 2"),
    ),
    Case(
        "mesh clockwise faces",
        "trimesh#2032",
        _write(lambda a: a.update(faces=a["faces"][:, ::-1])),
        (_MESH,),
        warned=("48 of 48 faces were clockwise",),
        right=_is_the_block,
    ),
    Case(
        "mesh mixed faces",
        "trimesh#2032",
        _write(lambda a: a.update(faces=np.r_[a["faces"][:9, ::-1], a["faces"][9:]])),
        (_MESH,),
        warned=("9 of 48 faces were clockwise",),
        right=_is_the_block,
    ),
    Case("mesh open below", "mikedh/trimesh#1419", _write(_open_below), (_MESH,), warned=("not closed",)),
    Case(
        "mesh one-based faces",
        "OBJ, MATLAB",
        _write(lambda a: a.update(faces=a["faces"] + 1)),
        (_MESH,),
        refused=("count from 1", "subtract 1"),
    ),
    Case(
        "mesh quads",
        "krishauser/Klampt#205",
        _write(lambda a: a.update(faces=a["faces"][:, [0, 1, 2, 2]])),
        (_MESH,),
        refused=("quads", "triangulate"),
    ),
    Case(
        "mesh row-vector poses",
        "gazebosim/sdformat#736",
        _write(lambda a: a.update(world_from_tool=np.swapaxes(a["world_from_tool"], 1, 2))),
        (_MESH,),
        refused=("not a rotation and a translation", "last row"),
    ),
    Case("mesh tool partly zero", "own", _write(_zeroed_tool), (_MESH,), refused=("tool's mesh is damaged", "0 0 0")),
    Case("mesh tool of loose triangles", "STL", _write(_soup_tool), (_MESH,), never=_CLOSED, right=_is_the_block),
]
_OF_USD = [
    Case("usd control", "own", _usd(), (_DISECT,), right=_is_the_pyramid),
    Case("usd declares z up", "NVIDIA/warp#143", _usd(turn=_FROM_Z, upAxis="Z"), (_DISECT,), right=_is_the_pyramid),
    Case(
        "usd z up undeclared",
        "NVIDIA/warp#143",
        _usd(turn=_FROM_Z),
        (_DISECT,),
        refused=("up axis seems to be wrong", '"up": "z"'),
    ),
    Case(
        "usd declares centimetres",
        "Autodesk/maya-usd#932",
        _usd(scale=100, metersPerUnit=0.01),
        (_DISECT,),
        right=_is_the_pyramid,
    ),
    Case(
        "usd and json contradict",
        "own",
        _usd(upAxis="Z", units={"length": "m", "up": "y"}),
        (_DISECT,),
        refused=("different units or axes", "upAxis", ".json: units"),
    ),
    Case("usd unit in the json", "own", _usd(scale=1000, units={"length": "mm"}), (_DISECT,), right=_is_the_pyramid),
    Case(
        "usd time codes of a rate",
        "OpenUSD#3513",
        _usd(codes=np.arange(1.0, 4), timeCodesPerSecond=30.0),
        (_DISECT,),
        right=_is_the_pyramid,
    ),
    Case(
        "usd time codes in the npz, too",
        "OpenUSD#3513",
        _usd(codes=np.arange(1.0, 4), times=np.arange(1.0, 4), timeCodesPerSecond=30.0),
        (_DISECT,),
        warned=("time codes, not seconds",),
        right=_is_the_pyramid,
    ),
    Case(
        "usd rate undeclared",
        "OpenUSD#3513",
        _usd(codes=np.arange(1.0, 4)),
        (_DISECT,),
        refused=("npz files differ", "timeCodesPerSecond", "30 time codes per second"),
    ),
    Case(
        "usd frame numbers everywhere, stated",
        "OpenUSD#3513",
        _usd(codes=np.arange(1.0, 4), times=np.arange(1.0, 4), units={"frames_per_second": 30}),
        (_DISECT,),
        right=_is_the_pyramid,
    ),
    Case(
        "usd frame numbers everywhere",
        "OpenUSD#3513",
        _usd(codes=np.arange(1.0, 4), times=np.arange(1.0, 4)),
        (_DISECT,),
        refused=("frame numbers", "frames_per_second"),
    ),
]
CASES = _OF_MESHES + [dataclasses.replace(case, needs=("pxr",)) for case in _OF_USD]
