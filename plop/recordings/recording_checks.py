"""Validity checks of a recording: done when it is opened, without reading images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import h5py
import numpy as np

from plop.errors import PlopError
from plop.geometry.rigid import check_rigid
from plop.recordings.array_checks import Part

FARTHEST_M = 100.0
"""Largest plausible coordinate of a camera in metres [m]."""

_OF_FILE = {
    "frames/time_s": Part((None,)),
    "tool/world_from_tool": Part((None, 4, 4)),
    "tool/mesh/vertices": Part((None, 3)),
    "tool/mesh/faces": Part((None, 3), "ui"),
}
_PICTURES = (None, None, None)
_OF_CAMERA = {
    "rgb": Part((*_PICTURES, 3)),
    "depth_m": Part(_PICTURES),
    "mask": Part(_PICTURES),
    "intrinsics": Part((3, 3)),
    "world_from_cam": Part((None, 4, 4)),
}

Refuse = Callable[..., NoReturn]
"""`refuse(problem, key, expected, found)` raises the PlopError."""


def check_recording_file(file: h5py.File, path: Path, *, maker: str) -> None:
    """Reject a recording that no stage can use.

    Args:
        file: The open recording; its layout is that of `plop.recordings.recording`.
        path: Its path, for messages.
        maker: How to make it again, for messages.

    Raises:
        PlopError: A part is missing or of another shape, there is only one frame, times do not increase, or poses or
            intrinsics are invalid. Names file and key.
    """

    def refuse(problem: str, key: str, expected: str, found: str) -> NoReturn:
        raise PlopError(
            problem,
            where=f"{path}:/{key}",
            expected=expected,
            found=found,
            fix=f"Correct the raw data if necessary. {maker} again.",
        )

    for name in ("name", "environment"):
        if name not in file.attrs:
            refuse("The recording is incomplete.", "", f"the attribute {name}", "nothing")
    if not isinstance(file.get("cameras"), h5py.Group) or not len(file["cameras"]):
        refuse("The recording has no camera.", "cameras", "at least one", "none")
    cameras = [f"{group}/{name}" for group in ("cameras", "scan") for name in file.get(group, {})]
    parts = _OF_FILE | {f"{key}/{name}": part for key in cameras for name, part in _OF_CAMERA.items()}
    for key, part in parts.items():
        _check_there(file.get(key), key, part, refuse)
    _check_lengths(file, refuse)
    _check_times(file["frames/time_s"][:], refuse)
    check_rigid(file["tool/world_from_tool"][:], f"{path}:/tool/world_from_tool", what="tool")
    for key in cameras:
        _check_sizes(file, key, refuse)
        _check_intrinsics(file[f"{key}/intrinsics"][:], f"{key}/intrinsics", refuse)
        poses = file[f"{key}/world_from_cam"][:]
        check_rigid(poses, f"{path}:/{key}/world_from_cam", what="camera")
        if np.abs(poses[:, :3, 3]).max(initial=0) > FARTHEST_M:
            refuse(
                "A camera is implausibly far away.",
                f"{key}/world_from_cam",
                "metres",
                f"{np.abs(poses[:, :3, 3]).max():.0f}: millimetres?",
            )


def _check_there(node: object, key: str, part: Part, refuse: Refuse) -> None:
    if not isinstance(node, h5py.Dataset):
        refuse("The recording is incomplete.", key, "this part", "nothing" if node is None else "another type")
    wrong = part.misfit(node)
    if wrong is not None:
        refuse("A part of the recording has an unexpected shape or type.", key, *wrong)


def _check_lengths(file: h5py.File, refuse: Refuse) -> None:
    frames = len(file["frames/time_s"])
    for key in ("tool/world_from_tool", *(f"cameras/{name}/rgb" for name in file["cameras"])):
        if len(file[key]) != frames:
            refuse(
                "The recording's lengths do not match.",
                key,
                f"{frames} frames, as in /frames/time_s",
                f"{len(file[key])} frames",
            )
    if frames < 2:
        refuse(
            "The recording is too short.",
            "frames/time_s",
            "2 frames or more",
            f"{frames} frame{'' if frames == 1 else 's'}",
        )


def _check_times(times: np.ndarray, refuse: Refuse) -> None:
    steps = np.diff(times, prepend=-np.inf)
    bad = ~(np.isfinite(times) & (steps > 0))
    if bad.any():
        frame = int(np.argmax(bad))
        after = f" after {times[frame - 1]:g} s" if frame else ""
        refuse(
            "Time does not increase.",
            "frames/time_s",
            "finite, strictly increasing seconds",
            f"{times[frame]:g} s at frame {frame}{after}",
        )


def _check_sizes(file: h5py.File, key: str, refuse: Refuse) -> None:
    shape = file[f"{key}/rgb"].shape
    for part in ("depth_m", "mask"):
        found = file[f"{key}/{part}"].shape
        if found != shape[:3]:
            refuse(
                "Depth or mask has another size than the image.",
                f"{key}/{part}",
                f"{_sizes(*shape[:3])}, as /{key}/rgb",
                _sizes(*found),
            )
    poses = len(file[f"{key}/world_from_cam"])
    if poses != shape[0]:
        refuse(
            "The recording's lengths do not match.",
            f"{key}/world_from_cam",
            f"{shape[0]} poses, as /{key}/rgb",
            f"{poses} poses",
        )


def _check_intrinsics(matrix: np.ndarray, key: str, refuse: Refuse) -> None:
    if not np.isfinite(matrix).all():
        refuse("A camera's intrinsics have values that are not finite.", key, "finite numbers", "NaN or infinity")
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        refuse(
            "A camera's focal length is not positive.",
            key,
            "fx, fy > 0",
            f"fx {matrix[0, 0]:.3f}, fy {matrix[1, 1]:.3f}",
        )


def _sizes(*shape: int) -> str:
    return "frames x height x width = " + " x ".join(str(length) for length in shape)
