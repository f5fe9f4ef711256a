"""Speed of training: one optimisation step of I2N on images."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.speed.measure import median_ms

GAUSSIANS, HORIZON = 3000, 4


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {"train_step_horizon_4_one_view_3k_s": step_s}


def step_s() -> float:
    """Forward, backward and optimiser of one window: horizon 4, one 128 x 128 view a step, 3,000 Gaussians [s]."""
    import torch

    from benchmarks.speed.block import recorded_block
    from plop.dynamics.filter.particle_filter import UpdateConfig
    from plop.dynamics.i2n.model import PlopModel
    from plop.gaussians.splat_ply import write_splat
    from plop.recordings.recording import Recording
    from stages.fit_init.episode import fit_object, usable_views
    from stages.fit_init.shell import surface_from_views
    from stages.fit_init.stage import FitInitConfig
    from stages.train.form import model_config
    from stages.train.objective import TrainingStep
    from stages.train.settings import TrainConfig
    from stages.train.tracks import load_track, track_episode
    from stages.train.windows import Window

    with recorded_block() as recording_path:
        folder = recording_path.parent
        with Recording(recording_path) as recording:
            views, table = usable_views(recording, []), recording.table_z_m
        fitted, _ = fit_object(surface_from_views(views), views, table, FitInitConfig(steps=5, count=GAUSSIANS))
        write_splat(folder / "object.ply", fitted)
        track_episode(
            recording_path,
            folder / "object.ply",
            folder / "track.h5",
            UpdateConfig(iterations=1),
            lambda done, frames: None,
        )
        track, config = load_track("block", recording_path, folder / "track.h5"), TrainConfig()
        model = PlopModel(model_config(config, [track]))
        optimiser = torch.optim.AdamW(model.parameters(), lr=config.learning_rate)
        step_loss = TrainingStep(model)
        window = Window(0, 2, HORIZON, (False, False), 0, (0, 1, 2, 3))

        def work() -> None:
            optimiser.zero_grad()
            loss, _ = step_loss([window], [track], config.weights, config.render, config.noise_m)
            loss.backward()
            optimiser.step()

        return median_ms(work) / 1000
