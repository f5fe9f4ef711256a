"""Time stamps in any unit, since 1970 or from a start of their own, come out in exact nanoseconds; or are refused."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from plop.errors import PlopError
from plop.recordings.readers.clock import UNKNOWN, Clock, TimeUnit, check_together, read_clock
from plop.recordings.readers.droid.align import check_overlap, check_speed, frames_of_rows

TODAY_NS = 1_691_359_984_123_456_789
UNITS = list(TimeUnit)


def steps_ns(hz: float, rows: int = 60, jitter: float = 0.2, seed: int = 0) -> np.ndarray:
    """Whole nanoseconds from 0, shape [rows]."""
    noise = np.random.default_rng(seed).normal(0, jitter, rows - 1).clip(-0.7, 0.7)
    return np.rint(np.cumsum(np.r_[0, (1 + noise) * 1e9 / hz])).astype(np.int64)


def read(values, documented=TimeUnit.MILLISECONDS, **more) -> Clock:
    clock = read_clock(values, documented=documented, where="x", **more)
    assert clock is not None
    return clock


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("hz", [0.5, 4, 15, 29.97, 60, 240, 1000])
def test_a_date_tells_the_unit_at_any_rate(unit, hz):
    truth = TODAY_NS + steps_ns(hz)
    decimals = read(truth / unit.value)
    assert (decimals.unit, decimals.since_1970) == (unit, True)
    assert np.abs(decimals.ns - truth).max() <= 256  # what float64 holds of today's date
    if unit is not TimeUnit.SECONDS:
        assert (read(truth // unit.value).ns == truth // unit.value * unit.value).all()


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("hz", [10, 15, 29.97, 60, 120, 240])
@pytest.mark.parametrize("start_s", [0.0, 1.7, 1234.5, 3e6])
@pytest.mark.parametrize("documented", [TimeUnit.MILLISECONDS, TimeUnit.SECONDS])
def test_a_clock_with_a_start_of_its_own_is_told_by_its_step(unit, hz, start_s, documented):
    truth = int(start_s * 1e9) + steps_ns(hz)
    clock = read(truth / unit.value, documented)
    assert (clock.unit, clock.since_1970) == (unit, False)
    assert np.abs(clock.since(int(truth[0])) - (truth - truth[0]) / 1e9).max() < 1e-6


@pytest.mark.parametrize("hz", [0.5, 1, 2, 400, 1000])
@pytest.mark.parametrize("documented", [TimeUnit.MILLISECONDS, TimeUnit.SECONDS])
def test_a_slow_or_fast_recording_keeps_its_documented_unit(hz, documented):
    assert read((10**9 * 7 + steps_ns(hz, jitter=0.05)) / documented.value, documented).unit is documented


def test_nanoseconds_keep_their_last_digit_also_from_json():
    stamps = [TODAY_NS + 66_666_667 * i for i in range(5)]
    for values in (np.array(stamps), json.loads(json.dumps(stamps)), [str(s) for s in stamps], [None, *stamps]):
        clock = read(values)
        assert clock.ns[clock.known].tolist() == stamps
    assert read([None, *stamps]).ns[0] == UNKNOWN


def test_what_is_unknown():
    values = np.array([np.nan, -1, 0, 1.7e12, 1.7e12 + 67, np.inf, 1.7e12 + 134])
    assert read(values).known.tolist() == [False, False, False, True, True, False, True]
    assert read(np.arange(5) * 67).known.all()  # zero as the start of a clock of its own
    assert read_clock(np.full(4, -1), documented=TimeUnit.SECONDS, where="x") is None


REFUSED = [
    (1_691_359_984_000 + 0.067 * np.arange(60), "in seconds it would span 3.95 s"),  # ms at the start, then s
    (np.arange(50.0), "each 1|steps of 1"),
    (np.arange(1, 50), "steps of 1"),
    (np.full(20, 1_691_359_984_000), "not at all"),
    (1_691_359_984_000 - 67 * np.arange(20), "backwards"),
    (np.repeat(1_691_359_984 + np.arange(4), 15), "equal the one before"),  # whole seconds
    ((1_691_359_984 + np.arange(4000) / 15).astype(np.float32), "float32"),
    (np.arange(30) * 1e6, "1 rows a second"),
    (np.array([["a"]]), "list of numbers"),
    ([1, "x"], "x"),
]


@pytest.mark.parametrize(("values", "named"), REFUSED)
def test_no_unit_makes_it_a_clock(values, named):
    with pytest.raises(PlopError) as caught:
        read_clock(values, documented=TimeUnit.MILLISECONDS, where="file: key")
    text = str(caught.value)
    assert any(word in text for word in named.split("|")) and "file: key" in text and caught.value.fix


def test_a_step_back_and_a_stamp_astray_are_told():
    truth = TODAY_NS // 10**6 + 67 * np.arange(40)
    back, astray = truth.copy(), truth.copy()
    back[20:] -= 1000
    astray[7] = 5
    assert "goes back 1 times, first by 0.933 s at row 20" in read(back).notes[0]
    assert read(astray).ns[7] == UNKNOWN and "row 7" in read(astray).notes[0]
    assert read(truth).notes == ()


def test_clocks_of_one_recording_go_together():
    since_1970, own = read(1.7e12 + 67 * np.arange(30)), read(67 * np.arange(30))
    check_together({"a": since_1970, "b": read(1.7e18 + 67e6 * np.arange(30))})
    with pytest.raises(PlopError, match="different origins"):
        check_together({"a": since_1970, "b": own})
    with pytest.raises(PlopError, match="different rates"):
        check_together({"a": own, "b": read(2 * np.arange(1, 31))})


@pytest.mark.parametrize(
    "rounded",
    [
        lambda ns: ns // 10**6,
        lambda ns: np.rint(ns / 1e6).astype(int),
        lambda ns: ns / 1e9,
        lambda ns: (ns // 10**3).tolist(),
    ],
)
def test_frames_are_found_across_units(tmp_path, rounded):
    stamps = TODAY_NS + steps_ns(30, 20, 0.05)
    kept = np.delete(stamps, 5)
    path = tmp_path / "1_timestamps.json"
    path.write_text(json.dumps(list(rounded(kept)), default=int))
    received = 1000 * read(stamps).since(int(stamps[0]))
    index, warnings = frames_of_rows(received, 19, path, int(stamps[0]), tmp_path / "1.mp4")
    assert index.tolist() == [0, 1, 2, 3, 4, -1, *range(5, 19)]
    assert any("1 of 20 rows (5)" in text for text in warnings)


def test_pictures_of_another_hour_and_an_impossible_speed_are_refused():
    robot = 67.0 * np.arange(20)
    check_overlap(robot, robot + 900, "x")
    with pytest.raises(PlopError, match="3600 s after them"):
        check_overlap(robot, robot + 3.6e6, "x")
    flange = np.zeros((20, 6))
    flange[:, 2] = 0.02 * np.arange(20)
    check_speed(flange, robot, "x")
    with pytest.raises(PlopError, match="20 m/s"):
        check_speed(flange, np.arange(20.0), "x")


def test_a_missing_filter_of_hdf5_is_named(tmp_path):
    from plop.recordings.readers.droid.h5 import node_of

    path = tmp_path / "trajectory.h5"
    for code, name in ((32015, "Zstandard"), (32001, "Blosc"), (40000, "an unknown filter")):
        with h5py.File(path, "w") as file:
            created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            created.set_chunk((4,))
            created.set_filter(code, h5py.h5z.FLAG_OPTIONAL, ())
            space = h5py.h5s.create_simple((4,))
            data = h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_INT64, space, created)
            h5py.Dataset(data)[:] = 7  # the filter is optional, so it is skipped
            assert node_of(file, path, "x")[0] == 7
            data.write_direct_chunk((0,), b"compressed", 0)
            with pytest.raises(PlopError, match=f"{name} .filter {code}.*intact"):
                node_of(file, path, "x")
