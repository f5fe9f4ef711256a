"""The table of errors in motions that nothing was fitted to."""

from __future__ import annotations

from typing import Any

from benchmarks.fresh_recordings import table


def test_a_row_tells_the_fall_and_how_many_episodes_are_better() -> None:
    def errors(rms: float, *episodes: float) -> dict[str, Any]:
        return {
            "rms_mm": rms,
            "floor_mm": 0.2,
            "persistence_mm": 7.0,
            "rigid_mm": 2.4,
            "episodes": {f"block_{k:03d}": value for k, value in enumerate(episodes)},
        }

    row = {
        "seed": 3,
        "hidden": {"tilt": {"gx_m_s2": 1.0}},
        "named": ["tilt", "adhesion"],
        "fresh": {"before": errors(2.0, 2.0, 1.0), "after": errors(0.5, 0.4, 1.5)},
        "diagnosed": {"before": errors(3.0, 3.0), "after": errors(0.3, 0.3)},
    }
    cells = [cell.strip() for cell in table([row]).splitlines()[-1].strip("|").split("|")]
    assert cells == [
        "3",
        "tilt; tilt, adhesion",
        "2.00 -> 0.50 (noise 0.20)",
        "1 of 2",
        "7.0, 2.4",
        "3.00 -> 0.30 (noise 0.20)",
    ]
