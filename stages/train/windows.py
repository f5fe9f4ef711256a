"""Windows: short segments of episodes for one optimisation step.

The windows of a step depend only on the seed and the number of the step, so that a resumed run has the
same result as an uninterrupted one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from plop.dynamics.interface import ParticleState
from stages.train.tracks import Track


@dataclass(frozen=True)
class Window:
    """A segment of one episode and its random draws."""

    episode: int
    start: int
    """First frame."""
    horizon: int
    """Steps to predict."""
    mirror: tuple[bool, bool]
    """Whether the step is mirrored across the frame's x and y axes."""
    noise_seed: int
    cameras: tuple[int, ...]
    """First camera to compare with, as a number modulo the count, one for each step."""


def draw_windows(
    motions: list[np.ndarray], count: int, horizon: int, *, seed: int, step: int, mirror: bool
) -> list[Window]:
    """Draw the windows of one optimisation step.

    Half of them start at any frame, half where the object moves: most frames of a cut show hardly any motion.

    Args:
        motions: For each episode the mean motion of each step, shape [T - 1] [m].
        count: Windows to draw.
        horizon: Steps in each; shorter where the episode is.
        seed: The run's seed.
        step: Number of the optimisation step.
        mirror: Also draw reflections.
    """
    rng = np.random.default_rng([seed, step])
    windows = []
    for _ in range(count):
        episode = int(rng.integers(len(motions)))
        steps = min(horizon, len(motions[episode]))
        starts = len(motions[episode]) - steps + 1
        weight = np.convolve(motions[episode], np.ones(steps), "valid")
        if rng.random() < 0.5 or weight.sum() <= 0:
            start = int(rng.integers(starts))
        else:
            start = int(rng.choice(starts, p=weight / weight.sum()))
        flips = (bool(rng.random() < 0.5), bool(rng.random() < 0.5)) if mirror else (False, False)
        cameras = tuple(int(c) for c in rng.integers(2**31, size=steps))
        windows.append(Window(episode, start, steps, flips, int(rng.integers(2**31)), cameras))
    return windows


def whole_episodes(lengths: list[int], count: int, horizon: int, views: int, *, seed: int, step: int) -> list[Window]:
    """Return the windows of one optimisation step of the epochs: each pass has every episode once, in random order.

    Every window starts at the first frame. Views follow one another from frame to frame and from pass to pass.

    Args:
        lengths: Steps of each episode.
        count: Windows in a step.
        horizon: Largest number of predicted frames.
        views: Views compared in each frame; 0 is all.
        seed: The run's seed.
        step: Number of the optimisation step within the epochs.
    """
    windows = []
    for number in range(step * count, (step + 1) * count):
        epoch, place = divmod(number, len(lengths))
        rng = np.random.default_rng([seed, 1, epoch])
        episode = int(rng.permutation(len(lengths))[place])
        steps = min(horizon, lengths[episode])
        cameras = tuple((epoch + k) * max(views, 1) for k in range(steps))
        windows.append(Window(episode, 0, steps, (False, False), number, cameras))
    return windows


def disturbed_start(track: Track, window: Window, noise_m: float) -> tuple[ParticleState, torch.Tensor]:
    """Return the window's first state, perturbed like the errors of a rollout.

    The perturbation is a shift of the whole object, an opening of the cut and independent noise; the
    history includes a share of it. Every fourth window is unperturbed.

    Args:
        track: The episode's track.
        window: The window.
        noise_m: Standard deviation of each part [m]; 0 for none.

    Returns:
        The state, and the displacement of each Gaussian, shape [N, 3] [m]: it is added to the targets, too,
        since no model can know that the object was elsewhere.
    """
    state = track.state(window.start)
    means = state.gaussians.means
    generator = torch.Generator("cpu").manual_seed(window.noise_seed)
    if noise_m <= 0 or torch.rand((), generator=generator, device="cpu") < 0.25:
        return state, torch.zeros_like(means)

    def drawn(*shape: int) -> torch.Tensor:
        """Draw on the CPU: the same numbers on every device."""
        return torch.randn(shape, generator=generator, device="cpu").to(means)

    shift = drawn(1, 3) + state.side[:, None] * drawn(1, 3)
    noise = noise_m * (shift + 0.3 * drawn(*means.shape))
    moved = replace(
        state,
        gaussians=state.gaussians.with_(means=means + noise),
        last_translation=state.last_translation + 0.3 * noise,
    )
    return moved, noise
