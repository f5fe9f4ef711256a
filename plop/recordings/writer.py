"""Write a recording frame by frame; the file appears when it is complete."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import numpy as np

from plop.artifacts.atomic_hdf5 import AtomicHdf5
from plop.errors import PlopError
from plop.recordings.recording import RECORDING_SCHEMA, Mesh


class RecordingWriter:
    """Write one recording; use as a context manager.

    The file is written under a scratch name and renamed on leaving the context without an error;
    after an error no file is left. The same calls give the same bytes.

    Args:
        path: Path of the recording, `<name>.h5`.
        name: Name of the episode.
        source: What it was made from, e.g. "disect".
        environment: Name of the environment.
        table_z_m: Height of the table [m]; None when there is none.
        time_s: Time of every frame, shape [T], T at least 2, strictly increasing [s].
        tool_mesh: The tool in its own frame.
        world_from_tool: Pose of the tool at every frame, shape [T, 4, 4].
    """

    def __init__(
        self,
        path: str | Path,
        *,
        name: str,
        source: str,
        environment: str,
        table_z_m: float | None,
        time_s: np.ndarray,
        tool_mesh: Mesh,
        world_from_tool: np.ndarray,
    ) -> None:
        self.path = Path(path)
        time_s, poses = np.asarray(time_s, np.float64), np.asarray(world_from_tool, np.float64)
        if time_s.ndim != 1 or len(time_s) < 2 or not np.isfinite(time_s).all() or (np.diff(time_s) <= 0).any():
            raise PlopError(
                "Time does not increase.",
                where=name,
                expected="2 or more finite, increasing seconds",
                found=f"{time_s[:5]}...",
            )
        self._check_poses(poses, len(time_s), f"{name}: tool")
        self._written: dict[str, np.ndarray] = {}
        self._output = AtomicHdf5(self.path)
        self._file = self._output.file
        self._file.attrs.update(
            schema=RECORDING_SCHEMA,
            name=name,
            source=source,
            environment=environment,
            units="m, s",
            world_frame="right-handed, z up",
            table_z_m=np.nan if table_z_m is None else float(table_z_m),
        )
        self._put("frames/time_s", time_s)
        self._put("tool/mesh/vertices", np.asarray(tool_mesh.vertices, np.float64))
        self._put("tool/mesh/faces", np.asarray(tool_mesh.faces, np.int64))
        self._put("tool/world_from_tool", poses)
        self._frames = len(time_s)

    def add_camera(
        self,
        name: str,
        intrinsics: np.ndarray,
        world_from_cam: np.ndarray,
        height: int,
        width: int,
        *,
        group: str = "cameras",
    ) -> None:
        """Add a camera.

        Args:
            name: Id of the camera.
            intrinsics: Matrix K, shape [3, 3] [px].
            world_from_cam: Pose at every frame, shape [T, 4, 4] (in "scan": one per scan frame).
            height: [px]
            width: [px]
            group: "cameras", or "scan" for a camera's scan before the interaction.
        """
        poses = np.asarray(world_from_cam, np.float64)
        self._check_poses(poses, self._frames if group == "cameras" else len(poses), f"{group}/{name}")
        key, frames = f"{group}/{name}", len(poses)
        self._put(f"{key}/intrinsics", np.asarray(intrinsics, np.float64))
        self._put(f"{key}/world_from_cam", poses)
        self._image(f"{key}/rgb", (frames, height, width, 3), np.uint8)
        self._image(f"{key}/depth_m", (frames, height, width), np.float32)
        self._image(f"{key}/mask", (frames, height, width), np.uint8)
        self._written[key] = np.zeros(frames, bool)

    def write_frame(
        self, name: str, frame: int, rgb: np.ndarray, depth_m: np.ndarray, mask: np.ndarray, *, group: str = "cameras"
    ) -> None:
        """Write one frame of one camera.

        Args:
            name: Id of the camera.
            frame: Index of the frame.
            rgb: Shape [H, W, 3], uint8.
            depth_m: Shape [H, W], float32 [m]; 0 = not measured (NaN and infinity become 0).
            mask: Shape [H, W], uint8, MaskLabel.
            group: As in `add_camera`.
        """
        key = f"{group}/{name}"
        expected = self._file[f"{key}/rgb"].shape[1:]
        for what, value, shape in (
            ("rgb", rgb, expected),
            ("depth_m", depth_m, expected[:2]),
            ("mask", mask, expected[:2]),
        ):
            if np.shape(value) != shape:
                raise PlopError(
                    "An image has the wrong shape.",
                    where=f"{self.path.stem}:/{key}/{what}",
                    expected=str(shape),
                    found=str(np.shape(value)),
                )
        depth = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0).astype(np.float32)
        self._file[f"{key}/rgb"][frame] = rgb
        self._file[f"{key}/depth_m"][frame] = depth
        self._file[f"{key}/mask"][frame] = mask
        self._output.check()
        self._written[key][frame] = True

    def add_truth(self, name: str, array: np.ndarray) -> None:
        """Store data known only to a simulator as `/truth/<name>`, which `Recording` does not read."""
        array = np.asarray(array)
        chunks = (1, *array.shape[1:]) if array.ndim == 3 else None
        self._put(f"truth/{name}", array, chunks=chunks)

    def add_truth_facts(self, facts_json: str) -> None:
        """Store the simulator's parameters (JSON text) as the attribute `facts` of `/truth`."""
        self._file.require_group("truth").attrs["facts"] = facts_json

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._check_complete()
                self._output.commit()
        finally:
            self._output.discard()

    def _check_complete(self) -> None:
        if not any(key.startswith("cameras/") for key in self._written):
            raise PlopError(
                "A recording needs at least one camera.", where=self.path.stem, expected="one or more", found="none"
            )
        for key, written in self._written.items():
            if not written.all():
                raise PlopError(
                    "Frames are missing.",
                    where=f"{self.path.stem}:/{key}",
                    expected=f"{len(written)} frames",
                    found=f"{int(written.sum())}",
                )

    @staticmethod
    def _check_poses(poses: np.ndarray, frames: int, where: str) -> None:
        if poses.shape != (frames, 4, 4) or not np.isfinite(poses).all():
            raise PlopError(
                "The poses have the wrong shape or are not finite.",
                where=where,
                expected=f"finite, shape {(frames, 4, 4)}",
                found=f"shape {poses.shape}, finite: {bool(np.isfinite(poses).all())}",
            )

    def _put(self, key: str, array: np.ndarray, chunks: tuple[int, ...] | None = None) -> None:
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if chunks else {}
        self._file.create_dataset(key, data=array, chunks=chunks, track_times=False, **options)

    def _image(self, key: str, shape: tuple[int, ...], kind: type) -> None:
        self._file.create_dataset(
            key,
            shape,
            kind,
            chunks=(1, *shape[1:]),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
            track_times=False,
        )
