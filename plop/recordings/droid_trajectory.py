"""Read what plop needs of DROID's trajectory.h5: robot poses, camera poses, clocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from plop.errors import PlopError, remembering

FLANGE = "observation/robot_state/cartesian_position"
CONTROL_HZ = 15.0
"""DROID's control rate; a clock only where no other is stored."""
FARTHEST_M = 5.0
"""A robot or camera farther than this from the robot's base is taken for millimetres [m]."""


@dataclass(frozen=True)
class DroidTrajectory:
    """The robot's side of one episode; T rows at about 15 Hz, base frame, metres, radians.

    Rows that a shorter key does not cover hold NaN (poses) or -1 (times).
    """

    path: Path
    rows: int
    flange: np.ndarray
    """Pose of the flange in the base, [x, y, z, a, b, c], shape [T, 6]."""
    robot_time_ms: np.ndarray
    """When the robot's state was read (or the best clock in its place), Unix ms, shape [T]; -1 unknown."""
    skipped: np.ndarray
    """Rows in which the robot was not commanded, bool, shape [T]."""
    camera_type: dict[str, int]
    """Cameras of this rig: serial -> 0 wrist, 1 or 2 exterior."""
    extrinsics: dict[str, np.ndarray]
    """"<serial>_left" -> camera in base, shape [T, 6]; cameras of this rig only."""
    gripper_offset: dict[str, np.ndarray]
    """"<serial>_left" -> camera in flange, shape [6]."""
    intrinsics: dict[str, np.ndarray]
    """"<serial>_left" -> K as stored (pixel centres at integers), shape [3, 3]."""
    received_ms: dict[str, np.ndarray]
    """serial -> frame_received, Unix ms, shape [T]; -1 unknown."""
    captured_ms: dict[str, np.ndarray]
    """serial -> estimated_capture, Unix ms, shape [T]; -1 unknown."""
    warnings: list[str] = field(default_factory=list)


def read_trajectory(path: Path, *, serials: dict[str, int] | None = None) -> DroidTrajectory:
    """Read one trajectory.h5.

    Args:
        path: The file.
        serials: Cameras by type (as `camera_type`) to use when the file does not say, e.g. from the metadata.

    Raises:
        PlopError: The file is absent, truncated, lacks a key that plop needs, or is in millimetres.
    """
    if not path.is_file():
        raise PlopError("The episode has no trajectory.", where=path, expected="trajectory.h5", found="nothing",
                        fix="Copy the file again, or leave the episode out.")  # fmt: skip
    try:
        with h5py.File(path, "r") as file:
            reader = _Reader(path, file)
            with remembering(reader.warnings):
                return reader.read(serials or {})
    except (OSError, RuntimeError) as error:
        raise PlopError("The trajectory cannot be read.", where=path, expected="a complete HDF5 file",
                        found=str(error), fix="Copy the file again, or leave the episode out.") from error  # fmt: skip


class _Reader:
    """Reads one open file; `rows` is fixed first, then every key is fitted to it."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.path, self.file, self.warnings = path, file, list[str]()
        self.truncated = self._node("action") is None
        if self.truncated:
            self.warnings.append(
                f"{path}: no `action` group, so the file was cut short; only its observations are used"
            )
        flange = self._node(FLANGE)
        if not isinstance(flange, h5py.Dataset) or flange.ndim != 2 or flange.shape[1] != 6 or not len(flange):
            found = "nothing" if flange is None else f"shape {getattr(flange, 'shape', 'of a group')}"
            raise PlopError("The trajectory has no poses of the flange.", where=f"{path}:/{FLANGE}",
                            expected="[T, 6] float64 with T >= 1", found=found,
                            fix="The episode cannot be used: leave it out.")  # fmt: skip
        self.rows = max(len(flange), self._longest_clock())

    def read(self, serials: dict[str, int]) -> DroidTrajectory:
        types = self._camera_types(serials)
        flange = self._rows(FLANGE, 6)
        check_pose(flange, where=f"{self.path}:/{FLANGE}", what="flange")
        poses = "observation/camera_extrinsics"
        keys = [key for key in self._names(poses) if key.split("_")[0] in types]
        stale = sorted({key.split("_")[0] for key in self._names(poses)} - set(types))
        if stale:
            self.warnings.append(
                f"{self.path}:/{poses}: {', '.join(stale)} not in camera_type, so another rig's; ignored"
            )
        offsets = {key.removesuffix("_gripper_offset"): self._rows(f"{poses}/{key}", 6) for key in keys
                   if key.endswith("_gripper_offset")}  # fmt: skip
        times = "observation/timestamp/cameras"
        received = {serial: self._time(f"{times}/{serial}_frame_received") for serial in types}
        return DroidTrajectory(
            path=self.path, rows=self.rows, flange=flange,
            robot_time_ms=self._robot_time(received),
            skipped=self._flag("observation/timestamp/skip_action"),
            camera_type=types,
            extrinsics={key: self._rows(f"{poses}/{key}", 6) for key in keys if not key.endswith("_gripper_offset")},
            gripper_offset={key: _first_finite(offset) for key, offset in offsets.items()},
            intrinsics=self._intrinsics(types),
            received_ms=received,
            captured_ms={serial: self._time(f"{times}/{serial}_estimated_capture") for serial in types},
            warnings=self.warnings,
        )  # fmt: skip

    def _node(self, key: str) -> h5py.Group | h5py.Dataset | None:
        """Give a node without ever following a link into another file."""
        node: h5py.Group | h5py.Dataset = self.file
        for part in key.split("/"):
            if not isinstance(node, h5py.Group):
                return None
            link = node.get(part, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise PlopError("The trajectory links into another file.", where=f"{self.path}:/{key}",
                                expected="the data themselves", found=f"a link to {link.filename}",
                                fix="Copy the data into the file: links are not followed.")  # fmt: skip
            if link is None:
                return None
            node = node.get(part)
        if isinstance(node, h5py.Dataset) and (node.external or node.is_virtual):
            raise PlopError("The trajectory keeps data in another file.", where=f"{self.path}:/{key}",
                            expected="the data themselves", found="an external or virtual data set",
                            fix="Copy the data into the file: links are not followed.")  # fmt: skip
        return node

    def _names(self, key: str) -> list[str]:
        node = self._node(key)
        return sorted(node) if isinstance(node, h5py.Group) else []

    def _longest_clock(self) -> int:
        node = self._node("observation/timestamp/control/step_start")
        return len(node) if isinstance(node, h5py.Dataset) else 0

    def _rows(self, key: str, width: int = 0) -> np.ndarray:
        """Read a key fitted to T rows: a short one lacks its early rows, unless the file was cut short."""
        node = self._node(key)
        shape = (self.rows, width) if width else (self.rows,)
        out = np.full(shape, np.nan)
        if not isinstance(node, h5py.Dataset):
            return out
        if node.shape[1:] != shape[1:]:
            raise PlopError("A key of the trajectory has another shape.", where=f"{self.path}:/{key}",
                            expected=f"{shape}", found=f"{node.shape}", fix="Leave the episode out.")  # fmt: skip
        values = np.asarray(node[: self.rows], dtype=np.float64)
        missing = self.rows - len(values)
        if missing and self.truncated:
            self.warnings.append(f"{self.path}:/{key}: the last {missing} of {self.rows} rows are missing")
            out[: len(values)] = values
            return out
        if missing:
            self.warnings.append(f"{self.path}:/{key}: {len(values)} rows instead of {self.rows}; "
                                 f"read as rows {missing}..{self.rows - 1} (absent in the early steps)")  # fmt: skip
        out[missing:] = values
        return out

    def _time(self, key: str) -> np.ndarray:
        values = self._rows(key)
        return np.where(np.isfinite(values), values, -1).astype(np.int64)

    def _flag(self, key: str) -> np.ndarray:
        return np.nan_to_num(self._rows(key)) > 0

    def _robot_time(self, received: dict[str, np.ndarray]) -> np.ndarray:
        """Give the robot's clock, or the best there is in its place."""
        for key in ("observation/timestamp/robot_state/read_end", "observation/timestamp/control/step_start"):
            times = self._time(key)
            if (times > 0).any():
                return times
        for serial, times in received.items():
            if (times > 0).any():
                self.warnings.append(f"{self.path}: the robot's clock is missing; camera {serial}'s is used, "
                                     "so a lag between pose and picture stays in")  # fmt: skip
                return times
        self.warnings.append(f"{self.path}: no clock is stored; {CONTROL_HZ:g} rows a second are assumed")
        return np.round((1 + np.arange(self.rows)) * 1000 / CONTROL_HZ).astype(np.int64)

    def _intrinsics(self, types: dict[str, int]) -> dict[str, np.ndarray]:
        found: dict[str, np.ndarray] = {}
        for key in self._names("observation/camera_intrinsics"):
            node = self._node(f"observation/camera_intrinsics/{key}")
            if key.split("_")[0] in types and isinstance(node, h5py.Dataset) and node.shape[1:] == (3, 3) and len(node):
                found[key] = np.asarray(node[-1], dtype=np.float64)
        return found

    def _camera_types(self, serials: dict[str, int]) -> dict[str, int]:
        types: dict[str, int] = {}
        for serial in self._names("observation/camera_type"):
            node = self._node(f"observation/camera_type/{serial}")
            if isinstance(node, h5py.Dataset) and len(node):
                types[serial] = int(node[-1])
        if not types and serials:
            self.warnings.append(f"{self.path}:/observation/camera_type: missing; the cameras of the metadata are used")
            types = dict(serials)
        if not types:
            raise PlopError("The cameras of the episode are unknown.", where=f"{self.path}:/observation/camera_type",
                            expected="serial -> 0 (wrist), 1 or 2 (exterior)", found="nothing, and no metadata file",
                            fix="Leave the episode out, or add its metadata_*.json.")  # fmt: skip
        return types


def check_pose(poses: np.ndarray, *, where: str, what: str) -> None:
    """Refuse poses whose numbers cannot be metres and radians.

    Args:
        poses: [x, y, z, a, b, c], shape [..., 6]; NaN rows are passed over.
        where: File and key, for the message.
        what: Whose pose it is, for the message.

    Raises:
        PlopError: Positions look like millimetres, or angles like degrees.
    """
    poses = np.atleast_2d(poses)
    poses = poses[np.isfinite(poses).all(-1)]
    if not len(poses):
        return
    distance = float(np.linalg.norm(poses[:, :3], axis=1).max())
    if distance > FARTHEST_M:
        raise PlopError(f"The {what}'s position does not look like metres.", where=where,
                        expected=f"within {FARTHEST_M:g} m of the robot's base", found=f"{distance:.1f}",
                        fix="Positions are metres: divide millimetres by 1000.")  # fmt: skip
    angle = float(np.abs(poses[:, 3:]).max())
    if angle > 2 * np.pi + 1e-3:
        raise PlopError(f"The {what}'s angles do not look like radians.", where=where,
                        expected="Euler angles xyz in radians", found=f"{angle:.1f}",
                        fix="Convert degrees to radians.")  # fmt: skip


def pose_from_json(value: Any, *, where: str, what: str) -> np.ndarray:
    """Read [x, y, z, a, b, c] from a JSON file, shape [6], metres and radians.

    Args:
        value: What the file holds.
        where: File and key, for the message.
        what: Whose pose it is, for the message.

    Raises:
        PlopError: These are not six finite numbers, or no metres and radians.
    """
    try:
        pose = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        pose = np.zeros(0)
    if pose.shape != (6,) or not np.isfinite(pose).all():
        raise PlopError(f"The {what}'s pose cannot be read.", where=where,
                        expected="[x, y, z, a, b, c]: six finite numbers, metres and radians", found=str(value)[:120],
                        fix="Correct the file.")  # fmt: skip
    check_pose(pose, where=where, what=what)
    return pose


def _first_finite(poses: np.ndarray) -> np.ndarray:
    good = np.isfinite(poses).all(1)
    return poses[np.argmax(good)] if good.any() else np.full(6, np.nan)
