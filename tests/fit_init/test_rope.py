"""A real object: photographs without depth, from four sides."""

from dataclasses import replace

import numpy as np

from plop.render.losses import RenderWeights
from stages.fit_init.episode import fit_object
from stages.fit_init.held_out import score_view
from stages.fit_init.stage import FitInitConfig
from tests.support.rope import rope_surface, rope_views


def test_photographs_of_a_rope_are_fitted_without_depth(shared_data):
    folder = shared_data / "gs_dynamics_demo"
    views, surface = rope_views(folder, 160, 120), rope_surface(folder)
    config = FitInitConfig(count=1200, filling="none", render=RenderWeights(depth=0.0))

    def psnr(steps: int) -> float:
        shell, _ = fit_object(surface, views, None, replace(config, steps=steps))
        return float(np.mean([score_view(shell, view)[0].psnr_db for view in views]))

    start, end = psnr(0), psnr(150)
    assert end > 25, "the rope is recognised"
    assert end > start + 3, "the fit, not the cloud, did it"
