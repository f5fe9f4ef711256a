"""Solve intrinsics and hand-eye poses from the user's images, and turn them into edits of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from plop.errors import PlopError
from plop.geometry.calibration.board_intrinsics import Intrinsics, calibrate_intrinsics, read_images
from plop.geometry.calibration.boards import Board
from plop.geometry.handeye.solve import difference
from plop.geometry.rigid import invert_rigid, pose_from_euler_xyz
from plop.recordings.edits import Edits
from plop.recordings.recording import Recording
from stages.calibrate.handeye_solve import SolvedCamera, solve_camera

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig


@dataclass
class Solved:
    """What the user's images say, per camera."""

    intrinsics: dict[str, Intrinsics] = field(default_factory=dict)
    handeye: dict[str, SolvedCamera] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @property
    def reprojection_px(self) -> dict[str, float]:
        """Root mean square error of the board images [px]."""
        return {name: found.rms_px for name, found in self.intrinsics.items()}

    def facts(self) -> dict:
        """Describe everything for calibration.json."""
        return {
            "intrinsics": {
                name: {
                    "rms_px": round(f.rms_px, 4),
                    "fx": f.matrix[0, 0],
                    "fy": f.matrix[1, 1],
                    "cx": f.matrix[0, 2],
                    "cy": f.matrix[1, 2],
                    "distortion": f.distortion.tolist(),
                    "used": f.used,
                    "missed": f.missed,
                }
                for name, f in self.intrinsics.items()
            },
            "handeye": {name: found.facts() for name, found in self.handeye.items()},
        }


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
    for name, folder in _by_camera(boards, recording, solved.warnings).items():
        found = calibrate_intrinsics(read_images(folder), board, where=folder)
        solved.intrinsics[name] = found
        if found.missed:
            solved.warnings.append(f"camera {name}: no board in {', '.join(found.missed)}")
        if found.board.legacy and not board.legacy:
            solved.warnings.append(f"camera {name}: its ChArUco board has the legacy pattern (OpenCV before 4.6)")
        bend = distortion_px(found)
        if bend > 1.0:
            solved.warnings.append(
                f"camera {name}: its lens bends the image by up to {bend:.1f} px: record undistorted images"
            )
    for name, folder in _by_camera(poses, recording, solved.warnings).items():
        matrix, distortion = _opencv_intrinsics(name, solved, recording)
        solved.handeye[name] = solve_camera(folder, board, matrix, distortion, config)
        solved.warnings += [f"camera {name}, hand-eye: {note}" for note in solved.handeye[name].notes]
        if not solved.handeye[name].used and name not in recording.camera_names:  # no verdict will say it
            solved.warnings.append(f"camera {name}: its hand-eye pose was not used: {solved.handeye[name].why_not}")
    return solved


def board_of(config: CalibrateConfig) -> Board:
    """Collect the board's settings."""
    return Board(
        config.board_kind,
        config.board_columns,
        config.board_rows,
        config.board_square_m,
        config.board_marker_m,
        config.board_dictionary,
        config.board_marker_id,
    )


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
            raise PlopError(
                "Board images and recording have different shapes.",
                where=f"camera {name}",
                expected=f"the proportions of {camera.width}x{camera.height}",
                found=f"{found.width}x{found.height}",
            )
        for group in groups:
            edits.intrinsics[f"{group}/{name}"] = found.half_integer_matrix * np.array([[scale], [scale], [1.0]])
    for name, answer in solved.handeye.items():
        if not answer.used:
            continue
        if name not in recording.camera_names:
            raise PlopError(
                "A wrist camera's recorded place in the gripper is unknown.",
                where=f"{recording.path}: camera {name}",
                expected="the camera in /cameras and /scan",
                found="it is in /scan only",
                fix="Correct the wrist camera's gripper offset in the raw data, then ingest again.",
            )
        old = np.stack([recording.camera(name, frame).world_from_cam for frame in range(len(recording))])
        if answer.mount == "fixed":
            _check_constant(
                name,
                old,
                recording,
                "A fixed camera moves in the recording.",
                "one pose for all frames",
                'Say "mount": "wrist" in poses.json, or --handeye-mount wrist.',
            )
            edits.poses[f"cameras/{name}"] = np.tile(answer.transform, (len(recording), 1, 1))
            continue
        tool_from_flange = invert_rigid(pose_from_euler_xyz(np.array(config.flange_from_tool)))
        flange = recording.world_from_tool @ tool_from_flange
        offsets = invert_rigid(flange) @ old
        _check_constant(
            name,
            offsets,
            recording,
            "A wrist camera does not move with the tool.",
            "a constant pose in the gripper",
            'Say "mount": "fixed" in poses.json, or --handeye-mount fixed, or correct calibrate.flange_from_tool.',
        )
        edits.poses[f"cameras/{name}"] = flange @ answer.transform
        if name in recording.scan_names:
            scan = np.stack(
                [recording.camera(name, i, group="scan").world_from_cam for i in range(recording.scan_length(name))]
            )
            edits.poses[f"scan/{name}"] = scan @ invert_rigid(offsets[0]) @ answer.transform
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


def _by_camera(folder: Path | None, recording: Recording, warnings: list[str]) -> Mapping[str, Path]:
    if folder is None:
        return {}
    known = sorted({*recording.camera_names, *recording.scan_names})
    inside = sorted(p for p in folder.iterdir() if p.is_dir()) if folder.is_dir() else []
    named = {p.name: p for p in inside if p.name in known}
    if not named:
        raise PlopError(
            "No sub-folder is named after a camera.",
            where=folder,
            expected=" or ".join(known),
            found=", ".join(p.name for p in inside) or "no sub-folder",
            fix="Put each camera's files into a folder with the camera's name.",
        )
    others = [p.name for p in inside if p.name not in named and not p.name.startswith((".", "__"))]
    if others:
        warnings.append(f"{folder}: {', '.join(others)} names no camera ({', '.join(known)}) and was not read")
    return named


def _opencv_intrinsics(name: str, solved: Solved, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    if name in solved.intrinsics:
        return solved.intrinsics[name].matrix, solved.intrinsics[name].distortion
    matrix = recording.camera(name, 0, group=groups_of(name, recording)[0]).intrinsics.copy()
    matrix[:2, 2] -= 0.5
    return matrix, np.zeros(5)


def _check_constant(name: str, poses: np.ndarray, recording: Recording, problem: str, expected: str, fix: str) -> None:
    apart = [difference(poses[0], pose) for pose in poses]
    angle, distance = max(a for a, _ in apart), max(d for _, d in apart)
    if angle > 1.0 or distance > 5.0:
        raise PlopError(
            problem,
            where=f"{recording.path}: camera {name}",
            expected=f"{expected} (within 1 deg, 5 mm)",
            found=f"{angle:.1f} deg, {distance:.0f} mm",
            fix=fix,
        )
