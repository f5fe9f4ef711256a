"""Detection of the format of a folder: formats that plop reads, and formats that it only recognises."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from plop.recordings.readers.folder_scan import FolderScan

PAGE = "docs/how-to/droid-layout.md"


@dataclass(frozen=True)
class Sight:
    """Evidence for a format."""

    by: str
    """E.g. "meta/info.json, codebase_version v3.0"."""
    folder: Path
    """Argument for the command of the format."""


@dataclass(frozen=True)
class Format:
    """One recognisable format."""

    name: str
    look: Callable[[FolderScan], Sight | None]
    """Returns the evidence in a folder; None when it has another format."""
    reader: str = ""
    """Name after `plop ingest` if plop reads it; "" otherwise."""
    layout: str = ""
    """Files in the folder, for a format that plop reads."""
    nearest: str = ""
    """Reader of the nearest format that plop reads."""
    advice: str = ""
    """How to convert to it, one sentence."""


@dataclass(frozen=True)
class Recognised:
    """A format with its evidence."""

    format: Format
    sight: Sight


def recognise(path: Path, formats: Iterable[Format] | None = None) -> Recognised | None:
    """Return the format of a file or folder; None when it is unknown.

    Args:
        path: An existing path.
        formats: Formats to try, the first match wins; all when absent.
    """
    look = FolderScan(path)
    for each in FORMATS if formats is None else formats:
        sight = each.look(look)
        if sight is not None:
            return Recognised(each, sight)
    return None


def _droid(look: FolderScan) -> Sight | None:
    found = look.find("trajectory.h5", "trajectory_im128.h5", "recordings/mp4", "recordings/svo", "metadata_*.json")
    return Sight(found[0].rstrip("/"), look.path) if found else None


def _disect(look: FolderScan) -> Sight | None:
    for name in look.find("*.npz"):
        if {"knife_position", "points_rest"} <= look.npz_keys(name):
            return Sight(f"{name} with points_rest and knife_position", look.folder(name))
    return None


def _mesh(look: FolderScan) -> Sight | None:
    for name in look.find("*.npz"):
        if {"vertices", "faces", "world_from_tool"} <= look.npz_keys(name):
            return Sight(f"{name} with vertices, faces and world_from_tool", look.folder(name))
    return None


def _lerobot(look: FolderScan) -> Sight | None:
    for name in look.find("meta/info.json"):
        version = look.json(name).get("codebase_version")
        if version:
            return Sight(f"{name}, codebase_version {version}", look.folder(name, 2))
    return None


def _rlds(look: FolderScan) -> Sight | None:
    found = look.find("*.tfrecord*")
    return Sight(found[0], look.folder(found[0])) if found else None


def _robomimic(look: FolderScan) -> Sight | None:
    for name in look.find("*.hdf5", "*.h5"):
        if look.hdf5_has(name, "data/demo_0") or look.hdf5_has(name, "data/demo_1"):
            return Sight(f"{name} with data/demo_<n>", look.folder(name))
    return None


def _aloha(look: FolderScan) -> Sight | None:
    for name in look.find("*.hdf5"):
        if look.hdf5_has(name, "observations/qpos"):
            return Sight(f"{name} with observations/qpos", look.folder(name))
    return None


def _zarr(look: FolderScan) -> Sight | None:
    found = look.find("*.zarr", "*.zarr.zip")
    return Sight(found[0].rstrip("/"), look.folder(found[0])) if found else None


def _phystwin(look: FolderScan) -> Sight | None:
    found = look.find("calibrate.pkl")
    pictures = look.find("color/0", "depth/0")
    return Sight(f"{found[0]} and {pictures[0]}", look.folder(found[0])) if found and pictures else None


def _nerfstudio(look: FolderScan) -> Sight | None:
    for name in look.find("transforms.json", "transforms_train.json"):
        if "frames" in look.json(name):
            return Sight(f"{name} with frames", look.folder(name))
    return None


def _colmap(look: FolderScan) -> Sight | None:
    found = [name for name in look.find("cameras.bin", "cameras.txt") if look.find("images.bin", "images.txt")]
    return Sight(found[0], look.folder(found[0])) if found else None


def _bag(look: FolderScan) -> Sight | None:
    found = look.find("*.mcap", "*.bag", "*.db3")
    return Sight(found[0], look.folder(found[0])) if found else None


def _surfaces(look: FolderScan) -> Sight | None:
    """Find a numbered sequence of surfaces: three or more of one name, or two without other files."""
    files = sorted(look.find("*.obj", "*.ply", "*.stl", "*.vtk", "*.vtu"))
    for stem, group in groupby(files, key=lambda name: re.sub(r"\d+(?=\.\w+$)", "#", name)):
        names = list(group)
        if "#" in stem and len(names) > 1:
            return Sight(f"{names[0]} to {Path(names[-1]).name}", look.folder(names[0]))
    return None


def _usd(look: FolderScan) -> Sight | None:
    found = look.find("*.usd", "*.usda", "*.usdc", "*.usdz")
    return Sight(found[0], look.folder(found[0])) if found else None


_AS_ROBOT = (
    "write its videos, depth, poses of the flange and of the cameras in DROID's layout: "
    "plop/recordings/readers/droid/writer.py does it"
)
_AS_MESH = (
    "write one <name>.npz and <name>.json for each episode: write_mesh_sequence of "
    "plop/recordings/readers/mesh/sequence.py does it"
)

FORMATS = (
    Format("DROID raw episodes", _droid, "droid", "<LAB>/{success|failure}/<date>/<time>/trajectory.h5"),
    Format("DiSECt recordings", _disect, "disect", "<name>.usd, <name>.npz and <name>.json"),
    Format("mesh sequences", _mesh, "mesh", "<name>.npz and <name>.json"),
    Format("LeRobot data set", _lerobot, nearest="droid", advice=_AS_ROBOT),
    Format(
        "RLDS / TFDS data set",
        _rlds,
        nearest="droid",
        advice="for DROID use the raw data instead of the RLDS copy, which has no depth; for others " + _AS_ROBOT,
    ),
    Format("robomimic HDF5 file", _robomimic, nearest="droid", advice=_AS_ROBOT),
    Format("ALOHA / ACT HDF5 file", _aloha, nearest="droid", advice=_AS_ROBOT),
    Format("Zarr replay buffer (UMI, diffusion policy)", _zarr, nearest="droid", advice=_AS_ROBOT),
    Format(
        "PhysTwin capture",
        _phystwin,
        nearest="droid",
        advice="it has images and depth but no poses of a robot's tool, which plop needs; if you know them, "
        + _AS_ROBOT,
    ),
    Format(
        "nerfstudio capture",
        _nerfstudio,
        nearest="droid",
        advice="it has images and camera poses (OpenGL axes) but neither depth nor a tool; if you have them, "
        + _AS_ROBOT,
    ),
    Format(
        "COLMAP model",
        _colmap,
        nearest="droid",
        advice="it has images and camera poses without a scale, but neither depth nor a tool; if you have "
        "them, " + _AS_ROBOT,
    ),
    Format("ROS bag or MCAP log", _bag, nearest="droid", advice="export its topics, then " + _AS_ROBOT),
    Format(
        "sequence of surfaces",
        _surfaces,
        nearest="mesh",
        advice="combine the frames with the tool's mesh, its poses and the times, then " + _AS_MESH,
    ),
    Format(
        "USD scene",
        _usd,
        nearest="mesh",
        advice="`ingest disect` reads DiSECt's own files only; extract points, tool and times from the layer, with "
        "its upAxis, metersPerUnit and timeCodesPerSecond, then " + _AS_MESH,
    ),
)
"""Formats in the order in which they are tried: those that plop reads first, the least specific last."""

READ = tuple(each for each in FORMATS if each.reader)
"""Those that plop reads."""


def format_of(reader: str) -> Format:
    """Return the format that `plop ingest <reader>` reads.

    Raises:
        KeyError: There is none.
    """
    return {each.reader: each for each in READ}[reader]
