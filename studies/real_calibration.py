"""Compare calibration with published answers: `python -m studies.real_calibration --data <folder>`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from plop.geometry.calibration.board_intrinsics import calibrate_intrinsics, read_images
from plop.geometry.calibration.boards import Board
from plop.geometry.handeye.solve import difference
from stages.calibrate.handeye_folder import read_handeye
from stages.calibrate.handeye_solve import choose


def realsense(folder: Path) -> dict:
    """Hand-eye and chessboard of handeye_calibration_ros2."""
    resource = folder / "handeye_realsense" / "resource"
    lines = (resource / "handeye_result_realsense.yaml").read_text().splitlines()
    numbers = [float(line[2:]) for line in lines if line.startswith("- ")]
    published = np.eye(4)
    published[:3, :3], published[:3, 3] = np.reshape(numbers[:9], (3, 3)), numbers[9:]
    board = Board("chessboard", 12, 9, 0.025)
    found = calibrate_intrinsics(read_images(folder / "camera_calibration" / "realsense"), board)
    matrix = found.matrix
    return {
        "chessboard": {
            "images": len(found.used),
            "rms_px": round(found.rms_px, 4),
            "fx": round(matrix[0, 0], 2),
            "fy": round(matrix[1, 1], 2),
            "cx": round(matrix[0, 2], 2),
            "cy": round(matrix[1, 2], 2),
        },
        "hand_eye": hand_eye_rows(resource, published),
    }


def franka(folder: Path) -> dict:
    """Hand-eye of franka-handeye."""
    result = folder / "data" / "hand-eye-calibration-output" / "calibration_result.json"
    published = np.array(json.loads(result.read_text())["T_cam_gripper"])
    return {"hand_eye": hand_eye_rows(folder / "data" / "captured-data", published)}


def hand_eye_rows(folder: Path, published: np.ndarray) -> dict:
    """Run all methods; give spread of the board and difference to the published answer."""
    data = read_handeye(folder)
    found = choose(data.base_from_gripper, data.cam_from_board, data.mount, "auto")
    rows = {}
    for each in found.scores:
        angle, distance = difference(each.result, published)
        rows[each.method] = {
            "spread_mm": round(each.spread_mm, 2),
            "spread_deg": round(each.spread_deg, 3),
            "to_published_deg": round(angle, 4),
            "to_published_mm": round(distance, 3),
        }
    return {"poses": len(data.base_from_gripper), "chosen": found.method, "methods": rows}


def main() -> None:
    """Print one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder with the data sets")
    data = parser.parse_args().data
    found = {
        "handeye_ros2_realsense": realsense(data / "handeye_ros2_realsense"),
        "franka_handeye": franka(data / "franka_handeye"),
    }
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
