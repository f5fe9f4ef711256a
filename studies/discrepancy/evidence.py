"""One episode's numbers, as the discrepancy model and the hypotheses take them; K patches, F frames, A knots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Evidence:
    """Residuals and responses of one episode; 0 where a patch was not seen."""

    name: str
    explained: bool
    """It is to be explained; else it is a reference, in which nothing is hidden."""
    residual: np.ndarray
    """Measured minus predicted displacement, [F, K, 3] [m]."""
    predicted: np.ndarray
    """Displacement that the base predicts, [F, K, 3] [m]."""
    noise_m: np.ndarray
    """Standard deviation of one measured coordinate, [K] [m]."""
    spread_m: np.ndarray
    """Standard deviation of the prediction between discretisations, [F, K] [m]."""
    seen: np.ndarray
    """Bool [F, K]."""
    place: np.ndarray
    """Of the patches at the first frame, about the object's foot, over its size, [K, 3] [-]."""
    tool_place: np.ndarray
    """Of the patches in the tool's frame, over the object's size, [F, K, 3] [-]."""
    phase: np.ndarray
    """Share of the motion that is over, [F] [-]."""
    tool_path: np.ndarray
    """Corners of the tool's box over the motion, in the object's frame, over its size, [20, 8, 3] [-]."""
    duration_s: float
    base: np.ndarray
    """Responses of the base's own parameters to one prior standard deviation, [F, K, 3, P] [m]."""
    responses: np.ndarray
    """Responses of the laws' knots, [F, K, 3, A] [m]."""
