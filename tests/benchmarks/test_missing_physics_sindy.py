"""The PySINDy baseline finds a law that accelerations do show."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.missing_physics.plan import BASE, DECOYS, TURNED
from benchmarks.missing_physics.sindy import STANDS_FOR, sindy_ranking
from plop.physics.effects.library import library
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.tools import blade_mesh
from plop.tracking.episode import Episode

DRAG_PER_S = 4.0
TIMES = np.arange(60) * 0.02


def episode(seed: int, *, drag_per_s: float) -> tuple[Episode, np.ndarray]:
    """Points that swing, each at its own pace; measured ones with a drag that the prediction lacks."""
    generator = np.random.default_rng(seed)
    start = generator.uniform([-0.03, -0.03, 0.02], [0.03, 0.03, 0.05], (40, 3))
    pace, size = generator.uniform(3, 8, (40, 1)), generator.normal(0, 0.01, (40, 3))
    swing = np.sin(pace * TIMES[:, None, None]) * size
    rate = pace * np.cos(pace * TIMES[:, None, None]) * size
    # v' = a - d v, x' = v, by small explicit steps between the frames
    measured, x, v = [start], start.copy(), rate[0].copy()
    for t in range(1, len(TIMES)):
        for part in range(50):
            now = TIMES[t - 1] + part * 0.02 / 50
            v = v + 0.02 / 50 * (-(pace**2) * np.sin(pace * now) * size - drag_per_s * v)
            x = x + 0.02 / 50 * v
        measured.append(x.copy())
    vertices, faces = blade_mesh()
    far = np.tile(np.eye(4), (len(TIMES), 1, 1))
    far[:, 0, 3] = 1.0
    tool = ToolMotion(vertices, faces, TIMES, far)
    points, none = np.stack(measured), np.zeros((0, 3))
    return Episode(f"swing_{seed}", TIMES, points, 1e-6, np.arange(40), tool, -1.0, start, none), start + swing


def test_a_drag_is_found():
    pytest.importorskip("pysindy", reason="the extra bench is not installed")
    pairs = [episode(seed, drag_per_s=DRAG_PER_S) for seed in range(3)]
    ranked = sindy_ranking([e for e, _ in pairs], [p for _, p in pairs])
    assert "drag" in ranked[0]


def test_terms_stand_for_effects_that_exist():
    hidden = {*TURNED, *BASE, *DECOYS}
    named = {effect for effects in STANDS_FOR.values() for effect in effects}
    assert named <= set(library())
    assert hidden - named == {"toughness"}
