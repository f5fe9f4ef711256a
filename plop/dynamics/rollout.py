"""Step a dynamics model through an episode's actions."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import torch

from plop.dynamics.episodes import Actions
from plop.dynamics.initial_scene import InitialScene
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.recordings.recording import Recording


def rollout(
    model: DynamicsModel, scene: InitialScene, actions: Recording | Sequence[ToolStep], *, seed: int = 0
) -> list[ParticleState]:
    """Predict an episode from its first frame and its actions.

    Args:
        model: Predicts.
        scene: The first frame.
        actions: The steps of the tool, or a recording whose tool motion is used; its images are not read.
        seed: Seed of the model's random numbers.

    Returns:
        The state of every frame, including the first one: one more than the number of steps.

    Raises:
        PlopError: A state is empty or not finite; names the frame.
    """
    device = scene.gaussians.means.device
    steps = Actions.of(actions, device).steps() if isinstance(actions, Recording) else list(actions)
    name = actions.name if isinstance(actions, Recording) else "rollout"
    return [state for state, _ in predict(model, model.init(scene), steps, name, seed)]


def predict(
    model: DynamicsModel, start: ParticleState, steps: list[ToolStep], name: str, seed: int
) -> Iterator[tuple[ParticleState, float]]:
    """Yield the state of every frame, the given one first, with the model's time for it [ms].

    Args:
        model: Predicts.
        start: State at frame 0.
        steps: Actions.
        name: The episode, for messages.
        seed: Seed of the generator that the model draws from.

    Raises:
        PlopError: A state is empty or not finite; names the frame.
    """
    generator = torch.Generator(start.gaussians.means.device).manual_seed(seed)
    state = start
    yield state, 0.0
    for frame, action in enumerate(steps, start=1):
        before = time.perf_counter()
        with torch.no_grad():
            state = model.step(state, action, generator=generator)
        spent_ms = (time.perf_counter() - before) * 1000
        _check_state(state.gaussians, name, frame)
        yield state, spent_ms


def _check_state(gaussians: Gaussians, name: str, frame: int) -> None:
    where = f"{name}, frame {frame}"
    if len(gaussians) == 0:
        raise PlopError(
            "The model removed every Gaussian.", where=where, fix="Train longer, or lower the merge threshold."
        )
    for field in ("means", "quats", "scales", "opacities"):
        bad = ~torch.isfinite(getattr(gaussians, field)).reshape(len(gaussians), -1).all(1)
        if bad.any():
            raise PlopError(
                f"The model predicts {field} that are not finite.",
                where=where,
                expected="finite numbers",
                found=f"{int(bad.sum())} of {len(bad)} Gaussians",
                fix="The model diverged: train with a smaller learning rate.",
            )
