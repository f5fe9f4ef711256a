"""The speed goals, and the table that compares the measured figures with them."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass

_SIGNS = {"<=": operator.le, ">=": operator.ge}


@dataclass(frozen=True)
class Goal:
    """One figure that `make bench` measures."""

    what: str
    """In words, with the size of the case."""
    unit: str
    sign: str
    """"<=" or ">="."""
    value: float
    scale: float = 1.0
    """Factor from the measured figure to the unit."""

    def line(self, measured: float | None) -> str:
        """Return the table's line."""
        goal = f"{self.sign} {self.value:g}{self.unit}"
        if measured is None:
            return f"| {self.what} | not measured | {goal} | |"
        figure = measured * self.scale
        reached = "yes" if _SIGNS[self.sign](figure, self.value) else "**no**"
        return f"| {self.what} | {_shown(figure)}{self.unit} | {goal} | {reached} |"


GOALS: dict[str, Goal] = {
    "raster_128_5k_fwd_bwd_ms": Goal("rasterizer, 128x128, 5,000 Gaussians, forward and backward", " ms", "<=", 15),
    "raster_128_5k_speedup_over_torch": Goal("the same, over the reference in plain torch", " times", ">=", 50),
    "raster_256_20k_fwd_bwd_ms": Goal("rasterizer, 256x256, 20,000 Gaussians, forward and backward", " ms", "<=", 60),
    "i2n_forward_10000_over_300": Goal("I2N forward, 10,000 particles over 300", " times", "<=", 1.6),
    "i2n_step_10000_over_300": Goal("a whole step of the model, 10,000 particles over 300", " times", "<=", 1.6),
    "i2n_step_3000_beside_a_busy_core_over_quiet": Goal(
        "a step of 3,000 particles beside a program that keeps a core busy, over one without", " times", "<=", 3
    ),
    "p2g_10000_ms": Goal("particles to grid, 10,000 particles, 32 channels", " ms", "<=", 3),
    "g2p_10000_ms": Goal("grid to particles, 10,000 particles, 32 channels", " ms", "<=", 3),
    "train_step_horizon_4_one_view_3k_s": Goal(
        "train: a step, horizon 4, one view a frame, 3,000 Gaussians", " s", "<=", 0.8
    ),
    "fit_init_6_views_128_3k_2000_steps_s": Goal(
        "fit-init: an episode, 6 views of 128x128, 3,000 Gaussians, 2,000 steps", " s", "<=", 60
    ),
    "ingest_128_images_per_s": Goal("ingest: images of 128x128 drawn", " a second", ">=", 10),
    "recording_read_one_frame_ms": Goal("one frame of one camera read from a recording", " ms", "<=", 5),
    "plop_help_s": Goal("`plop --help`", " s", "<=", 0.7),
    "engine_5k_2_threads_particle_steps_per_s": Goal(
        "engine, 5,000 particles, two threads, cut and contact included",
        " million particle-steps a second",
        ">=",
        4,
        1e-6,
    ),
    "engine_5k_cut_of_1_s_s": Goal("engine, a cut of 1 s, 5,000 particles", " s", "<=", 5),
    "engine_time_per_particle_40k_over_5k": Goal(
        "engine, time of a particle-step, 40,000 particles over 5,000", " times", "<=", 1.2
    ),
}
"""Name of the case -> goal, in the order of the table."""


def goals_table(cases: Mapping[str, float]) -> str:
    """Compare the measured figures with the goals, as a Markdown table."""
    lines = ["| what | measured | goal | reached |", "|---|---|---|---|"]
    return "\n".join(lines + [goal.line(cases.get(name)) for name, goal in GOALS.items()])


def _shown(figure: float) -> str:
    return f"{figure:.0f}" if figure >= 100 else f"{figure:.3g}"
