"""Colours that people with any colour vision tell apart (Okabe and Ito 2008), the same in pictures and pages."""

from __future__ import annotations

PREDICTION, PERSISTENCE, RIGID, FLOOR = "#0072b2", "#999999", "#e69f00", "#000000"
MODELS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#661100")
"""One for each model, in order; none is a baseline's."""
PHASE_COLOURS = {"approach": "#f2f2f2", "contact": "#fde9c8", "cut": "#f6d2e6", "hold": "#d5ecf9", "retract": "#d8efe4"}
ERROR_MAP = "viridis"
"""matplotlib's name of the colour map of errors; the pages draw the same."""


def colour_map(steps: int = 16) -> list[str]:
    """Give the colour map of errors as hex colours, small errors first."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    colours = colormaps[ERROR_MAP]
    return [to_hex(colours(k / (steps - 1))) for k in range(steps)]
