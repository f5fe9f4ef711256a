"""Predicted views in one HDF5 file, with the same keys as the cameras of a recording.

Layout (schema 1):

    /                      attributes: schema, name (of the episode), environment, units="m"
    /cameras/<id>/rgb      [T, H, W, 3] uint8, over black
    /cameras/<id>/depth_m  [T, H, W] float32 along the optical axis [m], 0 where nothing is rendered
    /cameras/<id>/mask     [T, H, W] uint8, see plop.geometry.view.MaskLabel

One frame per chunk, gzip level 1. The cameras are those of the recording.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from plop.artifacts.atomic_hdf5 import AtomicHdf5
from plop.artifacts.hdf5_reader import EpisodeFile
from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.view import View

VIEW_FILE_SCHEMA = 1


class ViewWriter(AtomicHdf5):
    """Write predicted views frame by frame; the file appears when the block ends without error."""

    def __init__(self, path: Path, *, name: str, environment: str, frames: int) -> None:
        super().__init__(path)
        self.frames = frames
        self.file.attrs.update(schema=VIEW_FILE_SCHEMA, name=name, environment=environment, units="m")

    def write_frame(self, frame: int, views: list[View]) -> None:
        """Write all cameras of one frame.

        Raises:
            PlopError: The disk is full.
        """
        for view in views:
            arrays = {"rgb": view.rgb, "depth_m": view.depth_m.astype(np.float32), "mask": view.mask}
            for key, array in arrays.items():
                self._dataset(f"cameras/{view.camera.name}/{key}", array)[frame] = array
        self.check()

    def _dataset(self, path: str, like: np.ndarray) -> h5py.Dataset:
        if path not in self.file:
            self.file.create_dataset(
                path,
                (self.frames, *like.shape),
                like.dtype,
                chunks=(1, *like.shape),
                compression="gzip",
                compression_opts=1,
                shuffle=True,
                track_times=False,
            )
        return self.file[path]


class ViewFile(EpisodeFile):
    """Read predicted views lazily; use as a context manager."""

    noun, schema, maker = "file of predicted views", VIEW_FILE_SCHEMA, "Run `plop rollout` for this episode"

    def _check(self) -> None:
        if "cameras" not in self._file:
            raise PlopError(
                "The file of predicted views is incomplete.",
                where=f"{self.path}:/cameras",
                expected="this key",
                found="nothing",
                fix=f"{self.maker} again.",
            )

    def __len__(self) -> int:
        return min((len(group["rgb"]) for group in self._file["cameras"].values()), default=0)

    def view(self, camera: Camera, frame: int) -> View:
        """Read one frame of one camera."""
        if camera.name not in self._file["cameras"]:
            raise PlopError(
                "A camera is missing in the predicted views.",
                where=self.path,
                expected=camera.name,
                found=", ".join(self.camera_names),
                fix="Run `plop rollout` on the same recordings.",
            )
        group = self._file["cameras"][camera.name]
        size = (camera.height, camera.width)
        if group["mask"].shape[1:] != size:
            raise PlopError(
                "The predicted views have another size.",
                where=f"{self.path}:/cameras/{camera.name}",
                expected=f"{size[0]}x{size[1]} px",
                found=f"{group['mask'].shape[1:]}",
                fix="Run `plop rollout` on the same recordings.",
            )
        return View(camera, group["rgb"][frame], group["depth_m"][frame], group["mask"][frame])
