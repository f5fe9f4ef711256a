from benchmarks.held_out import table


def test_environments_are_averaged_over_their_episodes_and_then_together():
    def fits(without: float, with_: float) -> dict[str, dict[str, float]]:
        return {
            "virtual_views 16": {"psnr_db": with_, "depth_error_mm": 0.5},
            "virtual_views 0": {"psnr_db": without, "depth_error_mm": 1.0},
        }

    rows = table(
        {
            "prism_jelly_part_004": fits(28, 34),
            "prism_jelly_part_005": fits(30, 36),
            "sphere_foam_part_004": fits(25, 31),
        }
    ).splitlines()[2:]
    assert rows == [
        "| prism-jelly | 29.0 | 35.0 | 1.00 | 0.50 |",
        "| sphere-foam | 25.0 | 31.0 | 1.00 | 0.50 |",
        "| **mean** | 27.0 | 33.0 | 1.00 | 0.50 |",
    ]
