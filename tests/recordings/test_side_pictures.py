"""Pictures beside a video belong to frames by the whole set of their numbers."""

from __future__ import annotations

import pytest

from plop.causes import Cause
from plop.errors import PlopError
from plop.recordings.readers.side_pictures import find_side_pictures


def found(folder, numbers, frames, form="{:06d}.png"):
    for number in numbers:
        (folder / form.format(number)).touch()
    return find_side_pictures(folder, frames, what="depth images", cause=Cause.DEPTH)


@pytest.mark.parametrize("form", ["{:06d}.png", "{:05d}.png", "{}.png", "depth_{:04d}.png", "cam2_{}.png"])
@pytest.mark.parametrize("start", [0, 1, 4, 1000])
def test_as_many_as_frames_are_one_a_frame(tmp_path, form, start):
    pictures = found(tmp_path, range(start, start + 14), 14, form)
    assert {frame: path.name for frame, path in pictures.paths.items()} == {
        frame: form.format(frame + start) for frame in range(14)
    }
    assert bool(pictures.notes) == (start > 0)


@pytest.mark.parametrize("numbers", [range(4, 14), [0, 1, 5, 9, 13], range(10), [13], range(0, 14, 2)])
def test_a_part_keeps_its_numbers(tmp_path, numbers):
    pictures = found(tmp_path, numbers, 14)
    assert sorted(pictures.paths) == list(numbers) and not pictures.notes


def test_what_may_be_a_frame_late_is_told(tmp_path):
    assert "frame late" in found(tmp_path, range(1, 14), 14).notes[0]


def test_one_more_than_frames_is_told(tmp_path):
    pictures = found(tmp_path, range(15), 14)
    assert pictures.paths[3].name == "000003.png" and "000014.png is not used" in pictures.notes[0]


REFUSED = [
    ([1, 2, 3, *range(5, 15)], "count from 1"),
    (range(0, 28, 2), "increase by 2"),
    (range(28), "28 images"),
    (range(1, 16), "000015.png"),
    ([10**12 + 67 * i + i % 3 for i in range(14)], "time stamps"),
]


@pytest.mark.parametrize(("numbers", "named"), REFUSED)
def test_numbers_that_no_frame_has_are_refused(tmp_path, numbers, named):
    with pytest.raises(PlopError) as caught:
        found(tmp_path, numbers, 14)
    assert named in str(caught.value) and caught.value.cause is Cause.DEPTH


@pytest.mark.parametrize("other", ["1.png", "mask_000001.png"])
def test_two_sets_in_one_folder_are_refused(tmp_path, other):
    (tmp_path / other).touch()
    with pytest.raises(PlopError, match="more than one set"):
        found(tmp_path, range(14), 14)
