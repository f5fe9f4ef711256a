"""Read a hand-eye pose that somebody else has solved.

    poses.json or pose.json    {"world_from_cam": 4x4} (or base_from_cam: a fixed camera in the robot's base), or
                               {"gripper_from_cam": 4x4} (a wrist camera); instead of 4x4 also
                               {"translation": [x, y, z], "quat_wxyz": [...]} or "quat_xyzw"
    *.yaml, *.yml, *.calib     result of easy_handeye or easy_handeye2: eye_on_base or eye_in_hand, quaternion x y z w

Metres, OpenCV's camera axes (x right, y down, z forward: ROS's optical frame).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.geometry.handeye.pairs import MAX_REACH_M
from plop.geometry.rigid import check_rigid, pose_from_quat_wxyz
from stages.calibrate.handeye_folder import by_rows, choose_mount, matrices, read_json, read_yaml, readable

KEYS = {"world_from_cam": "fixed", "base_from_cam": "fixed", "gripper_from_cam": "wrist"}


@dataclass(frozen=True)
class FinishedPose:
    """A camera's pose as given."""

    transform: np.ndarray
    """base_from_cam of a fixed camera, gripper_from_cam of a wrist camera, shape [4, 4] [m]."""
    mount: str
    """"wrist" or "fixed"."""
    notes: list[str] = field(default_factory=list)
    """What the user should know of how it was read."""


def read_finished(folder: Path, mount: str = "auto") -> FinishedPose | None:
    """Read a folder that holds a finished pose; None when it holds none (poses to solve from, or nothing).

    Args:
        folder: Of one camera.
        mount: The setting; "auto": as the file says.

    Raises:
        PlopError: A file is damaged, the pose is no rotation and translation, not in metres, of no optical frame, or
            says another mount than the setting.
    """
    return readable(folder, lambda: _read(folder, mount))


def _read(folder: Path, mount: str) -> FinishedPose | None:
    for path in (folder / "poses.json", folder / "pose.json"):
        facts = read_json(path) if path.is_file() else {}
        if facts and "base_from_gripper" not in facts:
            keys = [key for key in KEYS if key in facts]
            if len(keys) != 1:
                raise PlopError(
                    "A hand-eye file holds neither poses to solve from nor one finished pose.",
                    where=path,
                    expected=f"base_from_gripper, or one of {', '.join(KEYS)}",
                    found=", ".join(facts),
                )
            notes: list[str] = []
            pose = _pose(facts[keys[0]], keys[0], notes)
            return _checked(folder, path, pose, KEYS[keys[0]], mount, notes)
        if facts:
            return None
    for path in sorted(p for p in folder.iterdir() if p.suffix in (".calib", ".yaml", ".yml")):
        facts = read_yaml(path)
        if isinstance(facts, dict) and ("transform" in facts or "transformation" in facts):
            return _easy_handeye(folder, path, facts, mount)
    return None


def _pose(value: Any, key: str, notes: list[str]) -> np.ndarray:
    if not isinstance(value, dict):
        poses = matrices(value, key)
        if len(poses) != 1:
            raise ValueError(f"{key} holds {len(poses)} poses, not one")
        return by_rows(poses, "camera", notes)[0]
    if "quat_wxyz" in value:
        quat = np.array(value["quat_wxyz"], np.float64)
    else:
        quat = np.array(value["quat_xyzw"], np.float64)[[3, 0, 1, 2]]
    return _from_quat(np.array(value["translation"], np.float64), quat)


def _from_quat(place: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(quat_wxyz)
    if not abs(length - 1) < 1e-2:  # a NaN fails, too
        raise PlopError("A quaternion has not the length 1.", expected="1", found=f"{length:.3g}")
    return pose_from_quat_wxyz(place, quat_wxyz)


def _easy_handeye(folder: Path, path: Path, facts: dict[str, Any], setting: str) -> FinishedPose:
    known = {**facts, **(facts.get("parameters") or {})}
    if "calibration_type" in known:
        said = {"eye_on_base": "fixed", "eye_in_hand": "wrist", "eye_on_hand": "wrist"}.get(known["calibration_type"])
    else:
        on_hand = known.get("eye_on_hand", known.get("eye_in_hand"))
        said = None if on_hand is None else "wrist" if on_hand else "fixed"
    notes: list[str] = []
    if said is None:
        said = setting if setting != "auto" else choose_mount(folder, None, "auto", notes)
    body = facts.get("transform") or facts["transformation"]
    if "translation" in body:
        place = [body["translation"][axis] for axis in "xyz"]
        quat = [body["rotation"][axis] for axis in "wxyz"]
    else:
        place, quat = [body[axis] for axis in "xyz"], [body[f"q{axis}"] for axis in "wxyz"]
    _check_optical(path, str(known.get("tracking_base_frame", "")), notes)
    return _checked(folder, path, _from_quat(np.array(place, float), np.array(quat, float)), said, setting, notes)


def _check_optical(path: Path, frame: str, notes: list[str]) -> None:
    """Refuse ROS's body axes (REP 103: x forward): frames named _link or _frame, unless they are called optical."""
    if "optical" in frame:
        return
    if frame.endswith(("_link", "_frame")):
        raise PlopError(
            "A hand-eye result is of a frame without camera axes.",
            where=f"{path}: tracking_base_frame",
            expected="an optical frame (x right, y down, z forward), e.g. camera_color_optical_frame",
            found=f"{frame} (ROS: x forward, y left, z up)",
            fix="Multiply by the driver's transform from this frame to its optical frame (tf2_echo), and "
            "name that frame.",
        )
    notes.append(f"its frame {frame or '(not named)'} is taken for an optical one (z forward)")


def _checked(folder: Path, path: Path, pose: np.ndarray, said: str, setting: str, notes: list[str]) -> FinishedPose:
    if setting not in ("auto", said):
        raise PlopError(
            "A finished hand-eye pose is of another mount than handeye_mount says.",
            where=path,
            expected=setting,
            found=said,
            fix="Leave handeye_mount away.",
        )
    check_rigid(pose, str(path), what="camera")
    if np.abs(pose[:3, 3]).max() > MAX_REACH_M:
        raise PlopError(
            "A finished hand-eye pose seems to be in millimetres.",
            where=path,
            expected="metres",
            found=f"a translation of {np.abs(pose[:3, 3]).max():.0f}",
            fix="Divide it by 1000.",
        )
    return FinishedPose(pose, said, notes)
