"""How far faults move the object, one by one and together."""

from __future__ import annotations

import numpy as np
import pytest

from plop.sensors.estimation.finding import Viewed, effect_m, joint_effect_m
from plop.sensors.estimation.parameters import COUNT, SLICES

VIEWED = Viewed(np.array([0.0, 0.0, 0.4]), 0.05, 0.1)


def deviations(**values: list[float]) -> np.ndarray:
    out = np.zeros(COUNT)
    for name, part in values.items():
        out[SLICES[name]] = part
    return out


def test_each_fault_alone_moves_the_object_as_the_whole_does():
    for name, part, expected in (
        ("clock", [0.01], 1e-3),
        ("depth_scale", [0.01], 4e-3),
        ("depth_bias", [3e-3], 3e-3),
        ("pose_error", [0, 0, 2e-3, 0, 0, 0], 2e-3),
    ):
        values = deviations(**{name: part})
        assert effect_m(name, values[SLICES[name]], VIEWED) == pytest.approx(expected, rel=0.02)
        assert joint_effect_m([name], values, VIEWED) == pytest.approx(expected, rel=0.02)


def test_a_scale_and_a_shift_along_the_axis_cancel_on_the_object():
    values = deviations(depth_scale=[-0.006], pose_error=[0, 0, -0.0024, 0, 0, 0])
    assert joint_effect_m(["depth_scale"], values, VIEWED) > 0.002
    assert joint_effect_m(["depth_scale", "pose_error"], values, VIEWED) < 0.0003
