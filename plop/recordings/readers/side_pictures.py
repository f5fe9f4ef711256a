"""Images beside a video, one per frame (depth, masks): assignment to frames.

The assignment is determined from the whole set of files and the number of frames, never from the requested files only:
images numbered from 1 are one frame late everywhere, and only the missing first one shows it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from plop.causes import Cause
from plop.errors import PlopError


@dataclass(frozen=True)
class SidePictures:
    """The images of one camera."""

    folder: Path
    paths: dict[int, Path]
    """Frame of the video, counted from 0 -> image; frames without an image are absent."""
    notes: tuple[str, ...] = ()
    """The assumption that was made, for a warning."""

    def range_text(self) -> str:
        """Describe the images: "14 images, 000001.png .. 000014.png"."""
        return _range([self.paths[frame] for frame in sorted(self.paths)])


def find_side_pictures(folder: Path, frames: int, *, what: str, cause: Cause) -> SidePictures:
    """Assign an image to every frame.

    Numbers count the video's frames from 0, with any zero padding and any common prefix. As many images as frames,
    without a gap, are one per frame independent of the first number: there is no other interpretation. Otherwise
    numbers beyond the frames show that something else is counted.

    Args:
        folder: Folder of the images, `<number>.png`.
        frames: Frames of the video.
        what: Their kind, for messages, e.g. "depth images".
        cause: Cause of a fault.

    Raises:
        PlopError: Files are not distinguished by one number, or the numbers are not the video's frames.
    """
    numbered: dict[int, Path] = {}
    prefixes = set()
    for path in sorted(folder.glob("*.png")):
        parts = re.fullmatch(r"(.*?)(\d+)", path.stem)
        if parts is None:
            continue
        prefixes.add(parts[1])
        if len(prefixes) > 1 or int(parts[2]) in numbered:
            other = numbered.get(int(parts[2])) or next(iter(numbered.values()))
            raise PlopError(
                f"There is more than one set of {what}.",
                where=folder,
                expected="one image per frame: 000000.png, 000001.png, ...",
                found=f"{other.name} and {path.name}",
                fix="Keep one set in this folder.",
                cause=cause,
            )
        numbered[int(parts[2])] = path
    if not numbered:
        return SidePictures(folder, {})
    first, last, count = min(numbered), max(numbered), len(numbered)
    seen = _range([numbered[number] for number in sorted(numbered)])
    whole = last - first + 1 == count
    if first > 0 and whole and count == frames:
        note = (
            f"{folder}: {seen} for {frames} frames: numbered from {first}, so {numbered[first].name} is taken as "
            "frame 0"
        )
        return SidePictures(folder, {number - first: path for number, path in numbered.items()}, (note,))
    if last >= frames + (1 if first == 0 and whole else 0):
        raise PlopError(
            f"The numbers of the {what} are not those of the video's frames.",
            where=folder,
            expected=f"numbers 0 to {frames - 1}, as the video has {frames} frames; or one image per "
            "frame, numbered without a gap",
            found=seen,
            cause=cause,
            fix=_advice(sorted(numbered), frames),
        )
    notes = []
    if last >= frames:
        notes.append(f"{folder}: {seen}, but the video has {frames} frames: {numbered[last].name} is not used")
    elif first == 1 and whole and count == frames - 1:
        notes.append(
            f"{folder}: {seen} for {frames} frames, taken as frames 1 to {last}: if they are numbered from 1 "
            "and the last is missing, every one is a frame late: rename them to start with 0"
        )
    return SidePictures(folder, numbered, tuple(notes))


def _range(paths: list[Path]) -> str:
    return f"{len(paths)} images, {paths[0].name} .. {paths[-1].name}" if paths else "no images"


def _advice(numbers: list[int], frames: int) -> str:
    steps = {second - first for first, second in zip(numbers, numbers[1:], strict=False)}
    if numbers[0] == 1 and numbers[-1] == frames:
        return "They count from 1, and some are missing: subtract 1 from every number."
    if numbers[-1] > 100 * frames and len(steps) > 1:
        return "They seem to be time stamps: rename them to the frame of the video, from 000000.png."
    if len(steps) == 1 and (step := steps.pop()) > 1:
        return f"Numbers increase by {step}: rename them to the frame of the video, from 000000.png."
    return "Export one image per frame of the video, named by the frame, from 000000.png."
