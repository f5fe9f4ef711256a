"""Faults that all cameras share, so that they agree: unaligned depth, distances, turned pictures, tool axes."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from plop.recordings.recording import Mesh
from tests.cases.case import Case, Done
from tests.support.droid_scene import EXT1, EXT2, Scene, knife, make_episode

ROWS = 6


@dataclass
class Unaligned(Scene):
    """Depth is what a wider lens 15 mm beside the colour camera sees."""

    def render(self, world_from_cam, world_from_tool, rays_per_side=3):
        rgb = Scene(self.width, self.height, self.focal).render(world_from_cam, world_from_tool)[0]
        beside = world_from_cam.copy()
        beside[:3, 3] -= 0.015 * beside[:3, 0]
        _, depth, mask = Scene(self.width, self.height, 0.7 * self.focal).render(beside, world_from_tool, 1)
        return rgb, depth, mask


@dataclass
class Distance(Scene):
    """Depth is the distance along the ray."""

    def render(self, world_from_cam, world_from_tool, rays_per_side=3):
        rgb, depth, mask = super().render(world_from_cam, world_from_tool, rays_per_side)
        return rgb, depth * np.linalg.norm(self.camera(world_from_cam).pixel_directions(), axis=-1), mask


@dataclass
class UpsideDown(Scene):
    """Rows are stored from the last to the first."""

    def render(self, world_from_cam, world_from_tool, rays_per_side=3):
        return tuple(picture[::-1] for picture in super().render(world_from_cam, world_from_tool, rays_per_side))


def write(folder: Path, scene: Scene | None = None, mesh: Mesh | None = None) -> None:
    raw = folder / "raw"
    make_episode(raw, rows=ROWS, scene=scene or Scene(128, 96, 110.0), serials=(EXT1, EXT2))
    if mesh is not None:
        trimesh.Trimesh(mesh.vertices, mesh.faces).export(raw / "knife.stl")


def y_up() -> Mesh:
    """The knife as Blender exports it by default."""
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return replace(knife(), vertices=knife().vertices @ turn.T)


def all_good(done: Done) -> None:
    path = next((done.workspace / "artifacts" / "calibrate").glob("*/calibration.json"))
    cameras = json.loads(path.read_text())["cameras"]
    assert {each["verdict"] for each in cameras.values()} == {"good"}
    assert all({"edges", "table", "tool"} <= set(each["checks"].split("+")) for each in cameras.values())
    assert all(abs(each["table_mm"]) < 1 and each["tool_share"] > 0.9 for each in cameras.values())


INGEST, CALIBRATE, FUSE = "ingest droid raw", "calibrate", "fuse"
CASES = [
    Case("control", "", write, (INGEST, CALIBRATE, FUSE), right=all_good, never=("nan",)),
    Case(
        "depth-of-another-lens",
        "realsenseai/realsense-ros#2573",
        lambda f: write(f, Unaligned(128, 96, 110.0)),
        (INGEST, CALIBRATE),
        refused=("not aligned to the colour picture", "zoom 0.7", "before ingest"),
        never=("corrected",),
    ),
    Case(
        "distance-along-the-ray",
        "isaac-sim/IsaacLab#983",
        lambda f: write(f, Distance(128, 96, 80.0)),
        (INGEST, CALIBRATE),
        refused=("distance along the ray", "divide it by"),
        never=("corrected",),
    ),
    Case(
        "pictures-upside-down",
        "ARISE-Initiative/robomimic#203",
        lambda f: write(f, UpsideDown(128, 96, 110.0)),
        (INGEST, CALIBRATE),
        refused=("upside down", "the table is seen"),
        never=("hand-eye", "nan"),
    ),
    Case(
        "pictures-upside-down-fused",
        "ARISE-Initiative/robomimic#203",
        lambda f: write(f, UpsideDown(128, 96, 110.0)),
        (INGEST, FUSE),
        refused=("do not see the table at its stated height", "plop calibrate"),
        never=("nan",),
    ),
    Case(
        "tool-mesh-y-up",
        "open-dynamic-robot-initiative/trifinger_simulation#38",
        lambda f: write(f, mesh=y_up()),
        (INGEST, CALIBRATE),
        refused=("tool's mesh has other axes", "+90 deg about x"),
    ),
]
