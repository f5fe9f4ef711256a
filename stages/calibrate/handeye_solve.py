"""One camera's hand-eye pose: solved and judged, or taken as somebody else has solved it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plop.errors import PlopError
from plop.geometry.calibration.boards import Board
from plop.geometry.handeye.judge import judge_hand_eye
from plop.geometry.handeye.judgement import HandEyeFault, Judgement
from plop.geometry.handeye.solve import HAND_EYE_METHODS, HandEye, MethodScore, hand_eye, robot_world
from stages.calibrate.handeye_finished import read_finished
from stages.calibrate.handeye_folder import HandEyeData, read_handeye

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig

GIVEN = "given"
"""The method of a pose that somebody else has solved."""


@dataclass(frozen=True)
class SolvedCamera:
    """A camera's pose from hand-eye data, and what it is worth."""

    transform: np.ndarray
    """Fixed camera: base_from_cam. Wrist camera: gripper_from_cam. Shape [4, 4] [m]."""
    mount: str
    """"wrist" or "fixed"."""
    method: str
    why_not: str = ""
    """Why the recorded pose stays; empty when this one is used."""
    scores: list[MethodScore] = field(default_factory=list)
    """Of all methods, best first; none for a finished pose."""
    judgement: Judgement | None = None
    """None for a finished pose."""
    notes: list[str] = field(default_factory=list)
    """What was read otherwise than written, or is doubtful."""

    @property
    def used(self) -> bool:
        """Tell whether recordings get this pose."""
        return not self.why_not

    def trusted(self, limit_mm: float) -> bool:
        """Tell whether the pose is evidence against another camera: sharp, even were the board's size unknown."""
        return self.used and self.judgement is not None and self.judgement.scaled.uncertainty_mm <= limit_mm

    def columns(self) -> dict[str, float | str | None]:
        """Give the columns of the verdict."""
        first = self.scores[0] if self.scores else None
        return {
            "handeye_method": self.method,
            "handeye_spread_mm": _rounded(first.spread_mm if first else None, 2),
            "handeye_spread_deg": _rounded(first.spread_deg if first else None, 3),
        }

    def facts(self) -> dict:
        """Describe everything for calibration.json."""
        said = {
            "method": self.method,
            "mount": self.mount,
            "transform": self.transform.tolist(),
            "used": self.used,
            "why_not": self.why_not,
            "notes": self.notes,
            "methods": {
                s.method: {"spread_mm": _rounded(s.spread_mm, 4), "spread_deg": _rounded(s.spread_deg, 4)}
                for s in self.scores
            },
        }
        if self.judgement is None:
            return said
        judged = self.judgement
        return {
            **said,
            "limit_mm": round(judged.limit_mm, 2),
            "limit_deg": round(judged.limit_deg, 3),
            "uncertainty_mm": _rounded(judged.fit.uncertainty_mm, 2),
            "board_scale": round(judged.scaled.scale, 5),
            "board_scale_interval": [_rounded(value, 5) for value in judged.scaled.scale_interval],
        }


NO_COLUMNS: dict[str, float | str | None] = {
    "handeye_method": None,
    "handeye_spread_mm": None,
    "handeye_spread_deg": None,
}
"""The columns of a camera without hand-eye data."""


def solve_camera(
    folder: Path, board: Board, matrix: np.ndarray, distortion: np.ndarray, config: CalibrateConfig
) -> SolvedCamera:
    """Read one camera's folder and solve or take its pose.

    Args:
        folder: See `handeye_folder` and `handeye_finished`.
        board: In its images, where it holds images.
        matrix: K, pixel centres at integers, shape [3, 3] [px].
        distortion: OpenCV's coefficients.
        config: Methods, mount, and whether the board's scale is fitted.

    Raises:
        PlopError: What is in the folder cannot be read or can give no answer.
    """
    finished = read_finished(folder, config.handeye_mount)
    if finished is not None:
        return SolvedCamera(finished.transform, finished.mount, GIVEN, notes=finished.notes)
    data = read_handeye(folder, board=board, matrix=matrix, distortion=distortion, mount=config.handeye_mount)
    try:
        return _solve(data, config, 1e3 * board.square_m if data.board is not None else None)
    except PlopError as error:
        raise PlopError(
            error.problem,
            where=f"{folder}{f': {error.where}' if error.where else ''}",
            expected=error.expected,
            found=error.found,
            fix=error.fix,
        ) from error


def _solve(data: HandEyeData, config: CalibrateConfig, square_mm: float | None) -> SolvedCamera:
    robot, board, notes = data.base_from_gripper, data.cam_from_board, list(data.notes)
    if data.missed:
        notes.append(f"no board in {', '.join(data.missed)}")
    judged = judge_hand_eye(robot, board, data.mount)
    if judged.scale_is_off and config.fit_board_scale and judged.fault is not HandEyeFault.INCONSISTENT:
        board = board * np.array([[1, 1, 1, judged.scaled.scale]] * 3 + [[1, 1, 1, 1]])
        notes.append(f"{judged.scale_text(square_mm, advise=False)}: the board was scaled by it")
        judged = judge_hand_eye(robot, board, data.mount)
    elif judged.scale_is_off and judged.fault is HandEyeFault.NONE:
        notes.append(f"used, but {judged.scale_text(square_mm)}")
    if judged.fault is HandEyeFault.NONE and judged.doubtful:
        notes.append(
            f"its motion leaves the camera's place open by {judged.fit.uncertainty_mm:.0f} mm (standard error)"
        )
    why = judged.why(square_mm)
    try:
        found = choose(robot, board, data.mount, config.hand_eye_method)
    except PlopError:
        if not why:
            raise
        return SolvedCamera(judged.fit.moving_from_cam, data.mount, "none", why, [], judged, notes)
    best = found.scores[0]
    if not why and (best.spread_mm > judged.limit_mm or best.spread_deg > judged.limit_deg):
        why = (
            f"the best answer ({best.method}) lets the board move by {best.spread_mm:.1f} mm and "
            f"{best.spread_deg:.1f} deg (limits {judged.limit_mm:.1f} mm, {judged.limit_deg:.1f} deg): record more "
            "poses, or leave hand_eye_method at auto"
        )
    return SolvedCamera(found.result, data.mount, found.method, why, found.scores, judged, notes)


def choose(robot: np.ndarray, board: np.ndarray, mount: str, method: str) -> HandEye:
    """Run one method, or all ("auto"; with the robot-world methods for a wrist camera), and keep the best; unjudged."""
    found = hand_eye(
        robot, board, mount=mount, judged=True, methods=tuple(HAND_EYE_METHODS) if method == "auto" else (method,)
    )
    if method != "auto" or mount != "wrist":
        return found
    scores = sorted([*found.scores, *robot_world(robot, board).scores], key=lambda each: each.score)
    return HandEye(scores[0].method, scores[0].result, scores)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not np.isfinite(value) else round(float(value), digits)
