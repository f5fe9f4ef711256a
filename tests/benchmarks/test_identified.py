"""benchmarks.worlds.identified: what is left of the engine's own recordings is their noise."""

from __future__ import annotations

import pytest

from benchmarks.worlds.identified import misses
from tests.support.coarse_episodes import BASE, coarse_episode


def test_the_error_is_of_what_is_compared_and_beside_its_noise_and_motion() -> None:
    found = misses([coarse_episode(0), coarse_episode(1)], BASE, jobs=1)
    assert found["rms_mm"] == pytest.approx((sum(e**2 for e in found["episodes_mm"]) / 2) ** 0.5)
    assert 0.1 < found["noise_mm"] < 0.35  # 0.2 mm of a coordinate, over the points of a patch, in three coordinates
    assert found["noise_mm"] < found["rms_mm"] < found["moved_mm"]
