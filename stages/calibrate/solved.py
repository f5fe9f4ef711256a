"""Solve intrinsics and hand-eye poses from the user's images, and turn them into edits of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from plop.errors import PlopError
from plop.geometry.boards import Board, Intrinsics, calibrate_intrinsics, read_images
from plop.geometry.handeye import HAND_EYE_METHODS, HandEye, difference, hand_eye, robot_world
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from plop.recordings.recording import Recording
from stages.calibrate.handeye_folder import read_handeye
from stages.calibrate.pass_on import Edits

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig


@dataclass
class Solved:
    """What the user's images say, per camera."""

    intrinsics: dict[str, Intrinsics] = field(default_factory=dict)
    handeye: dict[str, HandEye] = field(default_factory=dict)
    mounts: dict[str, str] = field(default_factory=dict)
    """"wrist" or "fixed", for the cameras in `handeye`."""
    warnings: list[str] = field(default_factory=list)

    @property
    def reprojection_px(self) -> dict[str, float]:
        """Root mean square error of the board images [px]."""
        return {name: found.rms_px for name, found in self.intrinsics.items()}

    def facts(self) -> dict:
        """Describe everything for calibration.json."""
        return {
            "intrinsics": {
                name: {"rms_px": round(f.rms_px, 4), "fx": f.matrix[0, 0], "fy": f.matrix[1, 1],
                       "cx": f.matrix[0, 2], "cy": f.matrix[1, 2], "distortion": f.distortion.tolist(),
                       "used": f.used, "missed": f.missed}
                for name, f in self.intrinsics.items()
            },
            "handeye": {
                name: {"method": f.method, "mount": self.mounts[name], "transform": f.result.tolist(),
                       "methods": {s.method: {"spread_mm": _finite(s.spread_mm), "spread_deg": _finite(s.spread_deg)}
                                   for s in f.scores}}
                for name, f in self.handeye.items()
            },
        }  # fmt: skip


def solve(boards: Path | None, poses: Path | None, recording: Recording, config: CalibrateConfig) -> Solved:
    """Solve everything that the user gave images or poses for.

    Args:
        boards: Folder with one sub-folder of board images per camera.
        poses: Folder with one sub-folder of hand-eye poses per camera.
        recording: Any episode: names the cameras, and gives intrinsics where no board images do.
        config: Board and methods.

    Raises:
        PlopError: A sub-folder names no camera, or what is in it cannot be used.
    """
    solved, board = Solved(), board_of(config)
    for name, folder in _by_camera(boards, recording).items():
        found = calibrate_intrinsics(read_images(folder), board, where=folder)
        solved.intrinsics[name] = found
        if found.missed:
            solved.warnings.append(f"camera {name}: no board in {', '.join(found.missed)}")
        bend = distortion_px(found)
        if bend > 1.0:
            solved.warnings.append(f"camera {name}: its lens bends the image by up to {bend:.1f} px: "
                                   "record undistorted images")  # fmt: skip
    for name, folder in _by_camera(poses, recording).items():
        matrix, distortion = _opencv_intrinsics(name, solved, recording)
        data = read_handeye(folder, board=board, matrix=matrix, distortion=distortion)
        if data.missed:
            solved.warnings.append(f"camera {name}: no board in {', '.join(data.missed)}")
        solved.handeye[name] = choose(data.base_from_gripper, data.cam_from_board, data.mount, config.hand_eye_method)
        solved.mounts[name] = data.mount
    return solved


def board_of(config: CalibrateConfig) -> Board:
    """Collect the board's settings."""
    return Board(config.board_kind, config.board_columns, config.board_rows, config.board_square_m,
                 config.board_marker_m, config.board_dictionary, config.board_marker_id)  # fmt: skip


def choose(robot: np.ndarray, board: np.ndarray, mount: str, method: str) -> HandEye:
    """Run one method, or all ("auto"; with the robot-world methods for a wrist camera), and keep the best."""
    found = hand_eye(robot, board, mount=mount, methods=tuple(HAND_EYE_METHODS) if method == "auto" else (method,))
    if method != "auto" or mount != "wrist":
        return found
    scores = sorted([*found.scores, *robot_world(robot, board).scores], key=lambda each: each.score)
    return HandEye(scores[0].method, scores[0].result, scores)


def edits_for(recording: Recording, solved: Solved, config: CalibrateConfig) -> Edits:
    """Turn the solution into edits of one recording.

    A fixed camera stands where hand-eye says (the world is the robot's base). A wrist camera is carried by the
    gripper, whose pose is world_from_tool times the inverse of `flange_from_tool`; the poses of its scan, which
    the tool's poses do not cover, change by the same offset.

    Raises:
        PlopError: An image size does not match, or a wrist camera does not move with the tool.
    """
    edits = Edits()
    for name, found in solved.intrinsics.items():
        groups = groups_of(name, recording)
        camera = recording.camera(name, 0, group=groups[0])
        scale = camera.width / found.width
        if abs(camera.height / found.height - scale) > 0.01 * scale:
            raise PlopError("Board images and recording have different shapes.", where=f"camera {name}",
                            expected=f"the proportions of {camera.width}x{camera.height}",
                            found=f"{found.width}x{found.height}")  # fmt: skip
        for group in groups:
            edits.intrinsics[f"{group}/{name}"] = found.half_integer_matrix * np.array([[scale], [scale], [1.0]])
    for name, answer in solved.handeye.items():
        if name not in recording.camera_names:
            raise PlopError("A wrist camera's recorded place in the gripper is unknown.",
                            where=f"{recording.path}: camera {name}", expected="the camera in /cameras and /scan",
                            found="it is in /scan only",
                            fix="Correct the wrist camera's gripper offset in the raw data, then ingest "
                                "again.")  # fmt: skip
        if solved.mounts[name] == "fixed":
            edits.poses[f"cameras/{name}"] = np.tile(answer.result, (len(recording), 1, 1))
            continue
        tool_from_flange = invert_rigid(pose_from_euler_xyz(np.array(config.flange_from_tool)))
        flange = recording.world_from_tool @ tool_from_flange
        old = np.stack([recording.camera(name, frame).world_from_cam for frame in range(len(recording))])
        offsets = invert_rigid(flange) @ old
        _check_carried(name, offsets, recording)
        edits.poses[f"cameras/{name}"] = flange @ answer.result
        if name in recording.scan_names:
            scan = np.stack([recording.camera(name, i, group="scan").world_from_cam
                             for i in range(recording.scan_length(name))])  # fmt: skip
            edits.poses[f"scan/{name}"] = scan @ invert_rigid(offsets[0]) @ answer.result
    return edits


def groups_of(name: str, recording: Recording) -> list[str]:
    """Tell where a recording has a camera: "cameras", "scan" or both."""
    names = {"cameras": recording.camera_names, "scan": recording.scan_names}
    return [group for group, known in names.items() if name in known]


def distortion_px(found: Intrinsics) -> float:
    """Give the largest displacement of a pixel by the lens [px]."""
    x, y = np.meshgrid(np.linspace(0, found.width - 1, 9), np.linspace(0, found.height - 1, 9))
    pixels = np.stack([x, y], -1).reshape(-1, 1, 2)
    straight = cv2.undistortPoints(pixels, found.matrix, found.distortion, P=found.matrix)
    return float(np.linalg.norm(straight - pixels, axis=-1).max())


def _by_camera(folder: Path | None, recording: Recording) -> Mapping[str, Path]:
    if folder is None:
        return {}
    known = sorted({*recording.camera_names, *recording.scan_names})
    inside = sorted(p for p in folder.iterdir() if p.is_dir()) if folder.is_dir() else []
    named = {p.name: p for p in inside if p.name in known}
    if not named:
        raise PlopError("No sub-folder is named after a camera.", where=folder, expected=" or ".join(known),
                        found=", ".join(p.name for p in inside) or "no sub-folder",
                        fix="Put each camera's files into a folder with the camera's name.")  # fmt: skip
    return named


def _opencv_intrinsics(name: str, solved: Solved, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    if name in solved.intrinsics:
        return solved.intrinsics[name].matrix, solved.intrinsics[name].distortion
    matrix = recording.camera(name, 0, group=groups_of(name, recording)[0]).intrinsics.copy()
    matrix[:2, 2] -= 0.5
    return matrix, np.zeros(5)


def _check_carried(name: str, offsets: np.ndarray, recording: Recording) -> None:
    apart = [difference(offsets[0], offset) for offset in offsets]
    angle, distance = max(a for a, _ in apart), max(d for _, d in apart)
    if angle > 1.0 or distance > 5.0:
        raise PlopError("A wrist camera does not move with the tool.", where=f"{recording.path}: camera {name}",
                        expected="a constant pose in the gripper (within 1 deg, 5 mm)",
                        found=f"{angle:.1f} deg, {distance:.0f} mm",
                        fix='Say "mount": "fixed" in poses.json, or correct calibrate.flange_from_tool.')  # fmt: skip


def _finite(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None
