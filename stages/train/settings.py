"""Settings of `train`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

import numpy as np

from plop.dynamics.filter.particle_filter import UpdateConfig
from plop.dynamics.i2n.network import I2NConfig
from plop.dynamics.learned import DynamicsName
from plop.dynamics.peers.settings import PeerSettings
from plop.dynamics.resampling import ResamplingConfig
from plop.errors import PlopError
from plop.physics.scenes.varied_motion import VariationRanges
from plop.render.losses import RenderWeights
from plop.setting_kinds import (
    ALL_CORES,
    AUTO_DEVICE,
    COMMON,
    Formerly,
    Jobs,
    Range,
    Seed,
    Settings,
    Share,
    Unit,
    Weight,
)


@dataclass(frozen=True)
class LossWeights(Settings):
    """Weights of the terms of the loss; lengths are in `render.depth_unit_m`, like depth."""

    track: Weight = 1.0
    """Weight of the distance to the filter's track."""
    image: Weight = 1.0
    """Weight of the rendering loss in the second phase; 0 disables rendering."""
    rigid: Weight = 1.0
    """Weight Lambda_r of the rigidity term."""
    rotation: Weight = 0.05
    """Weight Lambda_rot of the rotation term."""
    isometry: Weight = 1.0
    """Weight Lambda_i of the isometry term."""
    sever: bool = True
    """Whether a blade separates neighbours in the last three terms; the paper keeps them."""


@dataclass(frozen=True)
class MadeUpConfig(VariationRanges):
    """Number of simulated episodes, and how far they may differ from the recorded ones."""

    episodes: Annotated[int, Range(0), Unit("episodes"), Formerly("made_up")] = 24
    """Number of simulated episodes if an engine is given."""


@dataclass(frozen=True)
class Schedule(Settings):
    """Training schedule."""

    seed: Annotated[Seed, COMMON] = 0
    """Seed of all random numbers."""
    track_steps: Annotated[int, Range(0), Unit("steps"), COMMON] = 700
    """Optimisation steps on the filter's tracks only."""
    image_steps: Annotated[int, Range(0), Unit("steps"), COMMON] = 100
    """Optimisation steps after those, with the rendering loss, on windows that start from the tracks."""
    epochs: Annotated[int, Range(0), Unit("epochs")] = 0
    """Instead of `image_steps`, the paper's: passes over the training episodes, each from its fitted Gaussians over all
    its frames (`horizon` at most). Without `track_steps` and `weights.track` there are no tracks then."""
    views: Annotated[int, Range(0), Unit("views")] = 1
    """Views in the rendering loss of a frame, in turn; 0 is all."""
    validation: Annotated[int, Range(0), Unit("episodes")] = 0
    """Training episodes that only select the weights; 0 selects on those that train."""
    batch: Annotated[int, Range(1), Unit("windows")] = 2
    """Windows per step, over all processes."""
    horizon: Annotated[int, Range(1), Unit("frames"), COMMON] = 4
    """Longest horizon of a window; the curriculum starts at 1 and doubles."""
    learning_rate: Annotated[float, Range(0, 1)] = 3e-3
    """Largest learning rate of Adam; see `schedule`."""
    schedule: Literal["cosine", "constant"] = "cosine"
    """"cosine" rises over the first tenth of the steps, then falls by a cosine; "constant" never changes."""
    averaging: Share = 0.98
    """Decay of the averaged weights; 0 averages none."""
    noise_m: Annotated[float, Range(0, 1), Unit("m")] = 0.001
    """Perturbation of a window's start."""
    mirror: bool = True
    """Mirror half of the windows."""
    validate_every: Annotated[int, Range(1), Unit("steps")] = 100
    """Steps between rollouts of the training episodes, which select the best weights."""
    checkpoint_every: Annotated[int, Range(1), Unit("steps")] = 25
    """Steps between checkpoints."""

    @property
    def steps(self) -> int:
        """Steps of both phases; see `counted`."""
        return self.track_steps + self.image_steps

    def counted(self, episodes: int) -> Self:
        """Return the schedule with its epochs over a number of episodes counted as `image_steps`."""
        return replace(self, image_steps=-(-self.epochs * episodes // self.batch)) if self.epochs else self

    def horizon_at(self, step: int) -> int:
        """Horizon of the curriculum: 1, 2, 4, ... each for the same time, so longer horizons have fewer steps."""
        horizons = [2**level for level in range(max(self.horizon, 1).bit_length()) if 2**level < self.horizon]
        horizons.append(self.horizon)
        shares = np.cumsum([1 / horizon for horizon in horizons])
        level = int(np.searchsorted(shares / shares[-1], step / max(self.track_steps, 1), side="right"))
        return horizons[min(level, len(horizons) - 1)]

    def rate_at(self, step: int) -> float:
        """Learning rate: constant, or a linear rise over a tenth of the steps and a cosine to a hundredth."""
        if self.schedule == "constant":
            return self.learning_rate
        rise = max(1, self.steps // 10)
        if step < rise:
            return self.learning_rate * (step + 1) / rise
        share_done = (step - rise) / max(1, self.steps - rise)
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share_done)))


@dataclass(frozen=True)
class TrainConfig(Schedule):
    """Settings of `train`; their defaults are defined only here."""

    dynamics: Annotated[DynamicsName, COMMON] = "i2n"
    """The model: "i2n", PLOP's; "gs-dynamics", "dpi-net", "transformer": peers, trained the same way, which ignore the
    settings `coupled`, `cohesion`, `cut_faces`, `network` and `resampling`."""
    frame: Literal["tool", "world"] = "tool"
    """Frame of the network: turns with the tool, or the world (the paper's)."""
    coupled: bool = True
    """A particle also follows a learned share of the tool's motion at its position; off in the paper."""
    cohesion: bool = True
    """Limit the distance of a Gaussian from its neighbours on its side of the cut in a rollout, as in the tracks; off
    in the paper."""
    cut_faces: bool = True
    """In a rollout a blade narrows the Gaussians that it passes, so that none extends across the cut; off in the
    paper."""
    folds: Annotated[int, Range(0, but=1), Unit("models")] = 0
    """Number of cross-validation folds: further models, each trained without its share of the episodes (2 or more; 0:
    none), from which `diagnose` estimates the error of the model in unseen episodes."""
    network: I2NConfig = I2NConfig()
    """Size and type of the network."""
    peers: PeerSettings = PeerSettings()
    """Networks of the peers."""
    resampling: ResamplingConfig = ResamplingConfig()
    """When Gaussians merge and split."""
    weights: LossWeights = LossWeights()
    """Weights of the terms of the loss."""
    render: RenderWeights = RenderWeights()
    """Weights of the rendering loss, also in the tracks."""
    update: UpdateConfig = UpdateConfig()
    """Settings of the filter that makes the tracks."""
    made_up: MadeUpConfig = MadeUpConfig()
    """Simulated episodes of an engine."""
    device: str = AUTO_DEVICE
    """Device: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes for tracks and simulated episodes; -1 is one per core. Sequential on a GPU."""

    @property
    def follows_tracks(self) -> bool:
        """Whether tracks are made: they are targets, or windows start from them."""
        return self.track_steps > 0 or self.weights.track > 0 or self.epochs == 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.steps + self.epochs < 1:
            raise PlopError(
                "There is nothing to train.",
                where="track_steps, image_steps, epochs",
                expected="at least one step",
                found="0, 0 and 0",
                fix="Set one of them to a number of steps.",
            )
        if not self.follows_tracks and self.cohesion:
            raise PlopError(
                "Cohesion is measured on tracks, and there are none.",
                where="train.cohesion, train.weights.track",
                expected="no cohesion, or tracks as targets",
                found="cohesion, with images alone as targets",
                fix="Set train.cohesion=false, or train.weights.track=1.",
            )
