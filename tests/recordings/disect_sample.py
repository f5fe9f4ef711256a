"""Write a tiny recording in DiSECt's own layout: a block of two tetrahedra pairs, cut in the middle."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

FRAMES = 3
NODES = np.array(
    [[-0.02, 0, -0.02], [0.02, 0, -0.02], [0.02, 0, 0.02], [-0.02, 0, 0.02], [0.0, 0.03, 0.0], [0.5, 0.5, 0.5]],
    np.float32,
)
"""A pyramid on the ground, y up, and one virtual node that no surface uses."""
SURFACE = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]])
BLADE = np.array(
    [[-0.001, 0, -0.05], [0.001, 0, -0.05], [0, -0.02, -0.05], [-0.001, 0, 0.05], [0.001, 0, 0.05], [0, -0.02, 0.05]],
    np.float32,
)
BLADE_FACES = np.array([[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]])
TIMES = np.array([0.05, 0.10, 0.15])


def knife_positions() -> np.ndarray:
    """The blade comes down along y, shape [T, 3]."""
    return np.array([[0.003, 0.06, 0.0], [0.003, 0.045, 0.0], [0.003, 0.03, 0.0]], np.float32)


def node_positions() -> np.ndarray:
    """The pyramid's top sinks a little, shape [T, N, 3]."""
    nodes = np.tile(NODES, (FRAMES, 1, 1))
    nodes[:, 4, 1] -= [0.0, 0.001, 0.002]
    return nodes


def side_arrays() -> dict[str, np.ndarray]:
    """The content of the npz file."""
    return {
        "times": TIMES,
        "knife_position": knife_positions(),
        "knife_quaternion_xyzw": np.tile(np.float32([0, 0, 0, 1]), (FRAMES, 1)),
        "knife_vertices": BLADE,
        "knife_faces": BLADE_FACES,
        "points_rest": NODES,
        "tets": np.array([[0, 1, 2, 4], [0, 2, 3, 4]]),
        "surface_clean": SURFACE,
        "cut_edge_indices": np.array([[0, 1], [3, 2]]),
        "cut_edge_coords": np.float32([0.5, 0.25]),
        "virtual_nodes": np.array([5]),
    }


def write_sample(
    folder: Path,
    name: str = "pyramid_jelly_part_000",
    *,
    nodes: np.ndarray | None = None,
    knife: np.ndarray | None = None,
    times: np.ndarray = TIMES,
    arrays: dict[str, np.ndarray] | None = None,
    environment: str = "pyramid-jelly",
) -> Path:
    """Write <name>.usd, .npz and .json; give the path of the USD file."""
    from pxr import Gf, Sdf, Vt

    nodes = node_positions() if nodes is None else nodes
    knife = knife_positions() if knife is None else knife
    layer = Sdf.Layer.CreateNew(str(folder / f"{name}.usd"))
    points = _attribute(layer, "particle_instancer", "PointInstancer", "positions", Sdf.ValueTypeNames.Point3fArray)
    place = _attribute(layer, "body_3", "Xform", "xformOp:translate", Sdf.ValueTypeNames.Double3)
    for time, sample, position in zip(times, nodes, knife):
        layer.SetTimeSample(points, time, Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(sample, np.float32)))
        layer.SetTimeSample(place, time, Gf.Vec3d(*[float(value) for value in position]))
    layer.Save()
    np.savez(folder / f"{name}.npz", **(side_arrays() if arrays is None else arrays))
    side = {"name": name, "environment": environment, "units": {"length": "m", "up": "y"}, "settings": {"ground": True}}
    (folder / f"{name}.json").write_text(json.dumps(side))
    return folder / f"{name}.usd"


def _attribute(layer: object, prim: str, kind: str, name: str, value_type: object) -> str:
    from pxr import Sdf

    spec = Sdf.CreatePrimInLayer(layer, f"/root/{prim}")
    spec.specifier, spec.typeName = Sdf.SpecifierDef, kind
    return str(Sdf.AttributeSpec(spec, name, value_type).path)
