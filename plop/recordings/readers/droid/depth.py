"""Depth for DROID videos: exported frames, stereo matching, or the ZED SDK."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from plop.causes import Cause
from plop.errors import PlopError
from plop.recordings.readers.side_pictures import SidePictures

SATURATED = 65535
"""A uint16 depth that overflowed; never a measurement."""


class DepthSource(Protocol):
    """Source of the depth of one frame."""

    name: str

    def depth_m(self, frame: int, left: np.ndarray, right: np.ndarray | None) -> np.ndarray:
        """Return depth along the left eye's optical axis.

        Args:
            frame: Frame number of the video.
            left: [H, W, 3] uint8 RGB.
            right: The other eye, same shape, or None.

        Returns:
            [h, w] float32 [m], 0 = not measured; any size with the image's aspect ratio.
        """
        ...


class ExportedDepth:
    """Exported depth images: `recordings/depth/<serial>/<frame>.png`, uint16 millimetres, 0 = none.

    Args:
        pictures: Images by frame.
    """

    name = "exported"

    def __init__(self, pictures: SidePictures) -> None:
        self.pictures, self.folder = pictures, pictures.folder
        self.missing: list[int] = []
        self.saturated: list[int] = []
        self.other_size: dict[str, list[int]] = {}
        """Finding -> frames."""

    def depth_m(self, frame: int, left: np.ndarray, right: np.ndarray | None) -> np.ndarray:
        """See DepthSource; a missing image has no measurements. Findings are stored for `warnings`."""
        path = self.pictures.paths.get(frame)
        if path is None:
            self.missing.append(frame)
            return np.zeros(left.shape[:2], np.float32)
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None or picture.dtype != np.uint16 or picture.ndim != 2:
            found = "not an image" if picture is None else f"{picture.dtype}, shape {picture.shape}"
            if picture is not None:
                found += ": a colour-mapped image of depth" if picture.ndim == 3 else ": scaled for display"
            raise PlopError(
                "A depth image has the wrong format.",
                where=path,
                expected="one channel, uint16, millimetres, 0 = not measured",
                found=found,
                fix="Export the measured depth itself as 16-bit PNG: np.uint16(np.round(1000 * metres)).",
                cause=Cause.DEPTH,
            )
        if abs(picture.shape[1] / picture.shape[0] - left.shape[1] / left.shape[0]) > 0.02:
            raise PlopError(
                "A depth image has another aspect ratio than the video.",
                where=path,
                expected=f"the aspect of {left.shape[1]}x{left.shape[0]}",
                found=f"{picture.shape[1]}x{picture.shape[0]}",
                fix="Export the left eye.",
            )
        if picture.shape != left.shape[:2]:
            found = f"{picture.shape[1]}x{picture.shape[0]} px, not the video's {left.shape[1]}x{left.shape[0]}"
            self.other_size.setdefault(f"{found} (rescaled to the stored images, nearest pixel)", []).append(frame)
        if (picture == SATURATED).any():
            self.saturated.append(frame)
        return np.where(picture == SATURATED, 0, picture).astype(np.float32) / 1000

    def warnings(self) -> list[str]:
        """Return warnings of frames without an image, with overflow, or of another size than the video."""
        nothing = f"no depth image (there are {self.pictures.range_text()})"
        named = (
            (nothing, self.missing),
            ("65535 (overflow, treated as not measured)", self.saturated),
            *self.other_size.items(),
        )
        return [
            f"{self.folder}: {what} for {len(frames)} frames: {', '.join(f'{x:06d}' for x in sorted(frames)[:8])}"
            for what, frames in named
            if frames
        ]


class StereoDepth:
    """Semi-global block matching on the rectified pair of a stereo video.

    Args:
        focal_px: fx of the left eye at the video's width [px].
        baseline_m: Stereo baseline [m].
        video_width: Width of one eye [px].
        match_width: Images are matched at this width or smaller [px].
        nearest_m: Smallest depth [m]; sets the largest disparity.
        farthest_m: Largest depth [m]; larger values are discarded.
    """

    name = "stereo"

    def __init__(
        self,
        focal_px: float,
        baseline_m: float,
        video_width: int,
        *,
        match_width: int = 640,
        nearest_m: float = 0.2,
        farthest_m: float = 2.5,
    ) -> None:
        self.scale = min(1.0, match_width / video_width)
        self.focal_baseline = focal_px * self.scale * baseline_m
        self.nearest_m, self.farthest_m = nearest_m, farthest_m
        largest = self.focal_baseline / nearest_m
        self.disparities = int(np.ceil((largest + 1) / 16)) * 16
        block = 5
        self.matcher = cv2.StereoSGBM_create(  # type: ignore[attr-defined]
            minDisparity=0,
            numDisparities=self.disparities,
            blockSize=block,
            P1=8 * 3 * block**2,
            P2=32 * 3 * block**2,
            disp12MaxDiff=1,
            uniquenessRatio=5,
            speckleWindowSize=50,
            speckleRange=2,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )

    def depth_m(self, frame: int, left: np.ndarray, right: np.ndarray | None) -> np.ndarray:
        """See DepthSource."""
        if right is None:
            raise PlopError(
                "Stereo depth needs both eyes.", where=f"frame {frame}", expected="a stereo video", found="one image"
            )
        pair = [self._prepared(image) for image in (left, right)]
        disparity = self.matcher.compute(*pair).astype(np.float32)[:, self.disparities :] / 16
        with np.errstate(divide="ignore"):
            depth = np.where(disparity > 0.5, self.focal_baseline / disparity, 0)
        return np.where((depth >= self.nearest_m) & (depth <= self.farthest_m), depth, 0).astype(np.float32)

    def _prepared(self, image: np.ndarray) -> np.ndarray:
        """Downscale, and pad on the left: the matcher gives no result within its largest disparity of that edge."""
        if self.scale < 1:
            image = cv2.resize(image, None, fx=self.scale, fy=self.scale, interpolation=cv2.INTER_AREA)
        return cv2.copyMakeBorder(image, 0, 0, self.disparities, 0, cv2.BORDER_REPLICATE)


class ZedDepth:
    """Depth of the ZED SDK from the SVO file. Needs `pyzed`, which comes with the SDK; not tested here."""

    name = "zed"

    def __init__(self, svo: Path) -> None:
        import pyzed.sl as sl

        self.sl, self.camera, self.position = sl, sl.Camera(), -1
        options = sl.InitParameters(svo_real_time_mode=False, coordinate_units=sl.UNIT.METER)
        options.set_from_svo_file(str(svo))
        if self.camera.open(options) != sl.ERROR_CODE.SUCCESS:
            raise PlopError(
                "The ZED SDK cannot open an SVO file.",
                where=svo,
                expected="a readable SVO",
                found="an error of the SDK",
                fix="Update the SDK or export depth images.",
            )
        self.image = sl.Mat()

    def depth_m(self, frame: int, left: np.ndarray, right: np.ndarray | None) -> np.ndarray:
        """See DepthSource."""
        if frame != self.position + 1:
            self.camera.set_svo_position(int(frame))
        if self.camera.grab() != self.sl.ERROR_CODE.SUCCESS:
            return np.zeros(left.shape[:2], np.float32)
        self.position = int(frame)
        self.camera.retrieve_measure(self.image, self.sl.MEASURE.DEPTH)
        depth = self.image.get_data()
        return np.where(np.isfinite(depth), depth, 0).astype(np.float32)


def zed_sdk_present() -> bool:
    """Return whether `pyzed` can be imported."""
    from importlib.util import find_spec

    return find_spec("pyzed") is not None


def find_svo(recordings: Path, serial: str) -> Path | None:
    """Find a camera's SVO file, in the present layout or the old one."""
    for folder in (recordings / "SVO", recordings):
        for suffix in (".svo", ".svo2"):
            if (folder / f"{serial}{suffix}").is_file():
                return folder / f"{serial}{suffix}"
    return None
