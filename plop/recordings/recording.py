"""The recording: one episode of multi-view RGB-D video and tool motion, in one HDF5 file.

Layout (schema 1; lengths in metres, times in seconds, world frame right-handed, z up):

    /                      attributes: schema, name, source, environment, units="m, s",
                           world_frame="right-handed, z up", table_z_m (NaN when there is no table)
    /frames/time_s         [T] float64, strictly increasing
    /cameras/<id>/rgb      [T, H, W, 3] uint8
    /cameras/<id>/depth_m  [T, H, W] float32 along the optical axis, 0 = not measured
    /cameras/<id>/mask     [T, H, W] uint8, see MaskLabel
    /cameras/<id>/intrinsics       [3, 3] float64 [px]
    /cameras/<id>/world_from_cam   [T, 4, 4] float64 (a fixed camera repeats its pose)
    /tool/mesh/vertices    [V, 3] float64 in the tool's frame; /tool/mesh/faces [F, 3] int64
    /tool/world_from_tool  [T, 4, 4] float64
    /scan/<id>/...         optional: the same keys as a camera, frames of a scan before the interaction
    /truth/...             optional: data known only to a simulator; never read for training

Images are stored one frame per chunk, so that one frame is read without the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from plop.artifacts.hdf5_reader import EpisodeFile
from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.view import View
from plop.recordings.open_recordings import of_this_run
from plop.recordings.recording_checks import check_recording_file

RECORDING_SCHEMA = 1


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh."""

    vertices: np.ndarray
    """[V, 3] float64 [m]"""
    faces: np.ndarray
    """[F, 3] int64, counter-clockwise seen from outside"""


class Recording(EpisodeFile):
    """Read one recording lazily; use as a context manager. `/truth` cannot be reached from here."""

    noun, schema, maker = "recording", RECORDING_SCHEMA, "Run `plop ingest` for this episode"

    def __init__(self, path: str | Path, *, checked: bool = False, on_close: Callable[[], None] | None = None) -> None:
        self._nodes: dict[tuple[str, str], dict[str, h5py.Dataset]] = {}
        self._checked, self._on_close = checked, on_close
        super().__init__(path)

    @classmethod
    def open(cls, path: str | Path) -> Recording:
        """Open a recording, or return the one that this run has open (`plop.recordings.open_recordings`)."""
        run = of_this_run()
        return cls(path) if run is None or not Path(path).is_file() else run.lend(Path(path), cls)

    def close(self) -> None:
        """Close the file, or return it to the run that keeps it open."""
        (self._on_close or super().close)()

    def close_file(self) -> None:
        """Close the file, even if a run keeps it open."""
        super().close()

    def _check(self) -> None:
        if not self._checked:
            check_recording_file(self._file, self.path, maker=self.maker)

    @property
    def table_z_m(self) -> float | None:
        """Height of the table [m], None when there is none."""
        height = float(self._file.attrs.get("table_z_m", np.nan))
        return None if np.isnan(height) else height

    @property
    def time_s(self) -> np.ndarray:
        """Time of every frame, shape [T] [s]."""
        return self._file["frames/time_s"][:]

    @property
    def scan_names(self) -> list[str]:
        """Names of the cameras with a scan before the interaction, sorted; often empty."""
        return sorted(self._file["scan"]) if "scan" in self._file else []

    def __len__(self) -> int:
        return len(self._file["frames/time_s"])

    def camera(self, name: str, frame: int, *, group: str = "cameras") -> Camera:
        """Return a camera's calibration at one frame; `group` is "cameras" or "scan"."""
        node = self._node(group, name)
        height, width = node["rgb"].shape[1:3]
        return Camera(name, width, height, node["intrinsics"][:], node["world_from_cam"][frame])

    def view(self, name: str, frame: int, *, group: str = "cameras") -> View:
        """Read one frame of one camera; `group` is "cameras" or "scan"."""
        node = self._node(group, name)
        return View(
            self.camera(name, frame, group=group), node["rgb"][frame], node["depth_m"][frame], node["mask"][frame]
        )

    def mask(self, name: str, frame: int) -> np.ndarray:
        """Read only the mask of one frame, shape [H, W], uint8, MaskLabel."""
        return self._node("cameras", name)["mask"][frame]

    def scan_length(self, name: str) -> int:
        """Number of frames of a scanning camera."""
        return len(self._node("scan", name)["rgb"])

    @property
    def tool_mesh(self) -> Mesh:
        """The tool in its own frame.

        Raises:
            PlopError: It has no vertices or no faces, or a face refers to a vertex that does not exist.
        """
        mesh = Mesh(self._file["tool/mesh/vertices"][:], self._file["tool/mesh/faces"][:])
        count = len(mesh.vertices)
        if not count or not len(mesh.faces) or mesh.faces.min() < 0 or mesh.faces.max() >= count:
            most = int(mesh.faces.max()) if len(mesh.faces) else None
            raise PlopError(
                "The tool's mesh is not valid.",
                where=f"{self.path}:/tool/mesh",
                expected="vertices, and faces that refer to them",
                found=f"{count} vertices, {len(mesh.faces)} faces"
                + ("" if most is None else f" with indices up to {most}"),
                fix=f"Correct the tool's mesh in the raw data, then: {self.maker} again.",
            )
        return mesh

    @property
    def world_from_tool(self) -> np.ndarray:
        """Pose of the tool at every frame, shape [T, 4, 4]."""
        return self._file["tool/world_from_tool"][:]

    def _node(self, group: str, name: str) -> dict[str, h5py.Dataset]:
        """Return a camera's datasets; opened once, since opening takes as long as reading one frame."""
        if (group, name) in self._nodes:
            return self._nodes[group, name]
        if group not in ("cameras", "scan") or group not in self._file or name not in self._file[group]:
            known = ", ".join(self.scan_names if group == "scan" else self.camera_names)
            raise PlopError(
                "There is no such camera.", where=f"{self.path}:/{group}/{name}", expected=known, found=name
            )
        self._nodes[group, name] = dict(self._file[group][name].items())
        return self._nodes[group, name]
