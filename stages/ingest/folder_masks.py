"""External object masks, one image per frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from plop.causes import Cause, Noticed
from plop.errors import PlopError
from plop.geometry.view import MaskLabel
from plop.recordings.readers.side_pictures import find_side_pictures
from stages.ingest.masks import GeometricMasker, Picture


class FolderMasker:
    """Read external masks: `<folder>/<episode>/<serial>/<frame>.png`, values as in MaskLabel.

    Args:
        folder: The folder of masks.
        frames: Frames of the video of each (episode, camera).
        binary: Any value but 0 is the object; the tool is then found by its mesh.
        geometric: Finds the tool for binary masks.
    """

    def __init__(
        self, folder: Path, frames: Mapping[tuple[str, str], int], *, binary: bool, geometric: GeometricMasker
    ) -> None:
        self.folder, self.binary, self.geometric = folder, binary, geometric
        self.pictures = {
            key: find_side_pictures(folder.joinpath(*key), count, what="masks", cause=Cause.MASKS)
            for key, count in frames.items()
        }

    def warnings(self) -> list[Noticed]:
        """Return the assumptions about the numbers."""
        return [
            Noticed(note, Cause.MASKS, "Check the numbers of the masks.")
            for pictures in self.pictures.values()
            for note in pictures.notes
        ]

    def mask(self, picture: Picture) -> np.ndarray:
        """See Masker.

        Raises:
            PlopError: There is no mask for this frame, or its values are not labels.
        """
        pictures = self.pictures[picture.episode, picture.camera.name]
        path = pictures.paths.get(picture.frame)
        if path is None:
            raise PlopError(
                "A frame has no mask.",
                where=f"{pictures.folder}: frame {picture.frame}",
                expected=f"{picture.frame:06d}.png",
                found=f"no such image; {pictures.range_text()}",
                fix="Write one mask per frame of the video, counted from 0.",
                cause=Cause.MASKS,
            )
        values = _mask_values(path)
        height, width = picture.depth_m.shape
        values = cv2.resize(values, (width, height), interpolation=cv2.INTER_NEAREST)
        if not self.binary:
            return _checked_labels(values, path)
        tool, _ = self.geometric.tool_pixels(picture)
        out = np.where(values > 0, MaskLabel.OBJECT, MaskLabel.BACKGROUND).astype(np.uint8)
        out[tool & (values == 0)] = MaskLabel.TOOL
        return out


def _mask_values(path: Path) -> np.ndarray:
    """Read a mask's values as stored, uint8, [H, W]: for a palette image the indices, never the colours."""
    try:
        with Image.open(path) as picture:
            mode, values = picture.mode, np.asarray(picture)
    except (OSError, ValueError, SyntaxError) as error:
        raise PlopError(
            "A mask cannot be read.",
            where=path,
            expected="an 8-bit PNG of one channel",
            found=str(error),
            fix="Write the masks again.",
            cause=Cause.MASKS,
        ) from error
    if mode == "1":
        return values.astype(np.uint8)
    if values.dtype != np.uint8 or (values.ndim == 3 and not (values[..., :1] == values[..., :3]).all()):
        raise PlopError(
            "A mask is not valid.",
            where=path,
            expected="an 8-bit PNG of one channel, or with a palette",
            found=f"{values.dtype}, {values.shape} ({mode})",
            fix="Write labels, not colours: 0 background, 1 object, 2 tool, 255 undecided.",
            cause=Cause.MASKS,
        )
    return values if values.ndim == 2 else np.ascontiguousarray(values[..., 0])


def _checked_labels(values: np.ndarray, path: Path) -> np.ndarray:
    present = set(np.unique(values).tolist())
    strange = present - {int(label) for label in MaskLabel}
    if strange or present == {0, 255}:
        two = len(present) == 2 and 0 in present
        raise PlopError(
            "A mask has other values than labels.",
            where=path,
            expected="0 background, 1 object, 2 tool, 255 undecided",
            found=f"the values {sorted(present)[:8]}" + (": two values, object or not" if two else ""),
            fix="Use --binary-masks: any value but 0 means the object."
            if two
            else "Relabel it, or use --binary-masks if any value but 0 means the object.",
            cause=Cause.MASKS,
        )
    return values
