"""Means over episodes and environments of the held-out views."""

from __future__ import annotations

import pytest

from benchmarks.datasets.held_out import means


def test_environments_are_averaged_over_their_episodes_and_then_together():
    def fits(without: float, with_: float) -> dict[str, dict[str, float]]:
        return {
            "virtual_views 16": {"psnr_db": with_, "depth_error_mm": 0.5},
            "virtual_views 0": {"psnr_db": without, "depth_error_mm": 1.0},
        }

    found = means(
        {
            "prism_jelly_part_004": fits(28, 34),
            "prism_jelly_part_005": fits(30, 36),
            "sphere_foam_part_004": fits(25, 31),
        }
    )
    assert list(found) == ["prism-jelly", "sphere-foam", "mean"]
    assert found["prism-jelly"]["virtual_views 16"] == {"psnr_db": 35.0, "depth_error_mm": 0.5}
    assert found["mean"]["virtual_views 0"] == {"psnr_db": pytest.approx(27.0), "depth_error_mm": 1.0}
