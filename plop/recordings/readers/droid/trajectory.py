"""Read DROID's trajectory.h5: robot poses, camera poses, clocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from plop.errors import PlopError, remembering
from plop.recordings.readers.clock import Clock, TimeUnit, check_together, read_clock
from plop.recordings.readers.droid.h5 import node_of
from plop.recordings.readers.droid.pose import check_pose

FLANGE = "observation/robot_state/cartesian_position"
OFFSET = "_gripper_offset"
"""Suffix of the key of a pose in the flange's frame instead of the base's."""
CONTROL_HZ = 15.0
"""DROID's control rate; used as a clock only where none is stored."""


@dataclass(frozen=True)
class DroidTrajectory:
    """The robot's data of one episode; T rows at about 15 Hz, base frame, metres, radians.

    Times are ms since `origin_ns`, computed as a difference of integer nanoseconds. Rows that a shorter key does not
    cover, and unknown times, are NaN.
    """

    path: Path
    rows: int
    flange: np.ndarray
    """Pose of the flange in the base, [x, y, z, a, b, c], shape [T, 6]."""
    robot_time_ms: np.ndarray
    """Time of the robot's state (or the best clock in its place), shape [T] [ms since `origin_ns`]."""
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
    """serial -> frame_received, shape [T] [ms since `origin_ns`]; none of a camera without it."""
    captured_ms: dict[str, np.ndarray]
    """serial -> estimated_capture, as `received_ms`."""
    origin_ns: int
    """First stamp of the robot's clock, on the scale of the recording's own stamps [ns]."""
    bad_clocks: dict[str, PlopError] = field(default_factory=dict)
    """serial -> why the camera's clock is not usable."""
    warnings: list[str] = field(default_factory=list)


def read_trajectory(path: Path, *, serials: dict[str, int] | None = None) -> DroidTrajectory:
    """Read one trajectory.h5.

    Args:
        path: The file.
        serials: Cameras by type (as `camera_type`) if the file has none, e.g. from the metadata.

    Raises:
        PlopError: The file is absent, truncated, lacks a key that plop needs, or is in millimetres.
    """
    if not path.is_file():
        raise PlopError(
            "The episode has no trajectory.",
            where=path,
            expected="trajectory.h5",
            found="nothing",
            fix="Copy the file again, or leave the episode out.",
        )
    try:
        with h5py.File(path, "r") as file:
            reader = _Reader(path, file)
            with remembering(reader.warnings):
                return reader.read(serials or {})
    except (OSError, RuntimeError) as error:
        raise PlopError(
            "The trajectory cannot be read.",
            where=path,
            expected="a complete HDF5 file",
            found=str(error),
            fix="Copy the file again, or leave the episode out.",
        ) from error


class _Reader:
    """Reader of one open file; `rows` is set first, then every key is adjusted to it."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.path, self.file, self.warnings = path, file, list[str]()
        self.units: dict[TimeUnit, list[str]] = {}
        self.truncated = self._node("action") is None
        if self.truncated:
            self.warnings.append(f"{path}: no `action` group, so the file is truncated; only its observations are used")
        flange = self._node(FLANGE)
        if not isinstance(flange, h5py.Dataset) or flange.ndim != 2 or flange.shape[1] != 6 or not len(flange):
            found = "nothing" if flange is None else f"shape {getattr(flange, 'shape', 'of a group')}"
            raise PlopError(
                "The trajectory has no poses of the flange.",
                where=f"{path}:/{FLANGE}",
                expected="[T, 6] float64 with T >= 1",
                found=found,
                fix="The episode is not usable: leave it out.",
            )
        self.rows = max(len(flange), self._longest_clock())

    def read(self, serials: dict[str, int]) -> DroidTrajectory:
        types = self._camera_types(serials)
        flange = self._rows(FLANGE, 6)
        check_pose(flange, where=f"{self.path}:/{FLANGE}", what="flange")
        poses = "observation/camera_extrinsics"
        own = {key: eye for key in self._names(poses) if (eye := _eye(key, types))}
        stale = sorted(set(self._names(poses)) - set(own))
        if stale:
            self.warnings.append(
                f"{self.path}:/{poses}: {', '.join(stale)} belong to no camera of camera_type "
                f"({', '.join(types)}), but to another rig; ignored"
            )
        stored = {eye: self._rows(f"{poses}/{key}", 6) for key, eye in own.items()}
        offsets = {eye: first_finite(offset) for eye, offset in stored.items() if eye.endswith(OFFSET)}
        bad_clocks = dict[str, PlopError]()
        cameras = {serial: self._camera_clocks(serial, bad_clocks) for serial in types}
        robot = self._robot_clock(cameras, bad_clocks)
        origin = int(robot.ns[robot.known][0]) if robot is not None else 0
        self.warnings += [
            f"{self.path}:/observation/timestamp: read in {unit.plural} (not milliseconds): {', '.join(names)}"
            for unit, names in self.units.items()
        ]
        received, captured = (
            {
                serial: 1000 * clock.since(origin)
                for serial, pair in cameras.items()
                if (clock := pair[which]) is not None
            }
            for which in (0, 1)
        )
        return DroidTrajectory(
            path=self.path,
            rows=self.rows,
            flange=flange,
            robot_time_ms=np.arange(self.rows) * 1000 / CONTROL_HZ if robot is None else 1000 * robot.since(origin),
            skipped=self._flag("observation/timestamp/skip_action"),
            camera_type=types,
            extrinsics={eye: pose for eye, pose in stored.items() if not eye.endswith(OFFSET)},
            gripper_offset={eye.removesuffix(OFFSET): offset for eye, offset in offsets.items()},
            intrinsics=self._intrinsics(types),
            received_ms=received,
            captured_ms=captured,
            origin_ns=origin,
            bad_clocks=bad_clocks,
            warnings=self.warnings,
        )

    def _node(self, key: str) -> h5py.Group | h5py.Dataset | None:
        return node_of(self.file, self.path, key)

    def _names(self, key: str) -> list[str]:
        node = self._node(key)
        return sorted(node) if isinstance(node, h5py.Group) else []

    def _longest_clock(self) -> int:
        node = self._node("observation/timestamp/control/step_start")
        return len(node) if isinstance(node, h5py.Dataset) else 0

    def _rows(self, key: str, width: int = 0) -> np.ndarray:
        """Read a key adjusted to T rows: a short one lacks its early rows, unless the file is truncated."""
        node = self._node(key)
        shape = (self.rows, width) if width else (self.rows,)
        out = np.full(shape, np.nan)
        if not isinstance(node, h5py.Dataset):
            return out
        if node.shape[1:] != shape[1:]:
            raise PlopError(
                "A key of the trajectory has another shape.",
                where=f"{self.path}:/{key}",
                expected=f"{shape}",
                found=f"{node.shape}",
                fix="Leave the episode out.",
            )
        values = np.asarray(node[: self.rows], dtype=np.float64)
        out[self._covered(key, len(values))] = values
        return out

    def _covered(self, key: str, count: int) -> slice:
        """Return which of the T rows a key of `count` rows covers."""
        missing = self.rows - count
        if self.truncated:
            if missing:
                self.warnings.append(f"{self.path}:/{key}: the last {missing} of {self.rows} rows are missing")
            return slice(0, count)
        if missing:
            self.warnings.append(
                f"{self.path}:/{key}: {count} rows instead of {self.rows}; "
                f"read as rows {missing}..{self.rows - 1} (absent in the early steps)"
            )
        return slice(missing, self.rows)

    def _clock(self, key: str) -> Clock | None:
        """Read a column of stamps without converting integers to floats; None: it is absent or empty."""
        node = self._node(key)
        if not isinstance(node, h5py.Dataset):
            return None
        values = node[: self.rows]
        if values.ndim == 1 and values.dtype.kind in "iuf":
            padded = np.full(self.rows, -1, values.dtype if values.dtype.kind != "u" else np.int64)
            padded[self._covered(key, len(values))] = values
            values = padded
        clock = read_clock(values, documented=TimeUnit.MILLISECONDS, where=f"{self.path}:/{key}")
        if clock is not None:
            if clock.unit is not TimeUnit.MILLISECONDS:
                self.units.setdefault(clock.unit, []).append(key.rpartition("/")[2])
            self.warnings += clock.notes
        return clock

    def _flag(self, key: str) -> np.ndarray:
        return np.nan_to_num(self._rows(key)) > 0

    def _camera_clocks(self, serial: str, bad: dict[str, PlopError]) -> tuple[Clock | None, Clock | None]:
        """Return frame_received and estimated_capture of a camera; record in `bad` why they are not usable."""
        key = f"observation/timestamp/cameras/{serial}"
        try:
            return self._clock(f"{key}_frame_received"), self._clock(f"{key}_estimated_capture")
        except PlopError as error:
            bad[serial] = error
            return None, None

    def _robot_clock(
        self, cameras: dict[str, tuple[Clock | None, Clock | None]], bad: dict[str, PlopError]
    ) -> Clock | None:
        """Return the robot's clock, or the best substitute; record cameras with inconsistent clocks in `bad`.

        Raises:
            PlopError: The robot's clock exists but is not valid.
        """
        robot = self._clock("observation/timestamp/robot_state/read_end")
        robot = robot or self._clock("observation/timestamp/control/step_start")
        if robot is None:
            others = [(serial, clock) for serial, pair in cameras.items() for clock in pair if clock is not None]
            serial, robot = others[0] if others else ("", None)
            used = f"the robot's clock is missing; camera {serial}'s is used, so a lag between pose and image remains"
            none = f"no clock is stored; {CONTROL_HZ:g} rows per second are assumed"
            self.warnings.append(f"{self.path}: {used if others else none}")
        for serial, pair in cameras.items():
            try:
                for clock in pair:
                    if robot is not None and clock is not None:
                        check_together({"the robot's clock": robot, f"camera {serial}'s": clock})
            except PlopError as error:
                bad[serial] = error
        return robot

    def _intrinsics(self, types: dict[str, int]) -> dict[str, np.ndarray]:
        found: dict[str, np.ndarray] = {}
        for key in self._names("observation/camera_intrinsics"):
            node, eye = self._node(f"observation/camera_intrinsics/{key}"), _eye(key, types)
            if eye and isinstance(node, h5py.Dataset) and node.shape[1:] == (3, 3) and len(node):
                found[eye] = np.asarray(node[-1], dtype=np.float64)
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
            raise PlopError(
                "The cameras of the episode are unknown.",
                where=f"{self.path}:/observation/camera_type",
                expected="serial -> 0 (wrist), 1 or 2 (exterior)",
                found="none, and no metadata file",
                fix="Leave the episode out, or add its metadata_*.json.",
            )
        return types


def _eye(key: str, cameras: Mapping[str, int]) -> str | None:
    """Return the eye of a key, "<camera>_left" or "_right", with "_gripper_offset" kept; None: of no camera.

    A camera's name may contain anything: only the known suffixes are removed, and a key that equals a camera's name is
    its left eye.
    """
    offset = OFFSET if key.endswith(OFFSET) else ""
    eye = key.removesuffix(OFFSET)
    if eye.endswith(("_left", "_right")) and eye.rpartition("_")[0] in cameras:
        return eye + offset
    return f"{eye}_left{offset}" if eye in cameras else None


def first_finite(poses: np.ndarray) -> np.ndarray:
    """Return the first pose [6] without unknown numbers; NaN where there is none."""
    good = np.isfinite(poses).all(1)
    return poses[np.argmax(good)] if good.any() else np.full(6, np.nan)
