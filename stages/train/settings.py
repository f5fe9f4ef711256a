"""Settings of `train`."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Literal

from plop.checked_settings import check_jobs, check_ranges
from plop.dynamics.i2n.features import FeatureSet
from plop.errors import PlopError


@dataclass(frozen=True)
class TrainConfig:
    """Settings of `train`; their defaults are written only here."""

    seed: int = 0
    """Seed of everything random."""
    track_steps: int = 700
    """Optimisation steps on the filter's tracks alone."""
    image_steps: int = 100
    """Optimisation steps after those, with the rendering loss."""
    batch: int = 2
    """Windows in a step, over all processes."""
    horizon: int = 4
    """Longest horizon of a window, in frames; the curriculum starts at 1 and doubles."""
    learning_rate: float = 3e-3
    """Largest learning rate of Adam; rises over the first tenth, then falls by a cosine."""
    averaging: float = 0.98
    """Decay of the averaged weights that are kept [-]."""
    noise_m: float = 0.001
    """Disturbance of a window's start [m]."""
    mirror: bool = True
    """See windows mirrored half of the time."""
    validate_every: int = 100
    """Steps between rollouts of the training episodes, from which the best weights are chosen."""
    checkpoint_every: int = 25
    """Steps between checkpoints."""
    kernel: Literal["paper", "quadratic", "cubic"] = "quadratic"
    """Kernel between particles and grid: 8, 27 or 64 nodes."""
    features: FeatureSet = "contact"
    """What a particle tells the network; "contact" adds place and motion relative to the tool, "oriented" also how the
    table's axes lie: for a table that rubs differently along x and y, as DiSECt's does."""
    frame: Literal["tool", "world"] = "tool"
    """Frame of the network: turns with the tool, or the world (the paper's)."""
    coupled: bool = True
    """A particle also takes a learned share of the tool's motion at its place; off in the paper."""
    cohesion: bool = True
    """In a rollout a Gaussian keeps to its neighbours on its side of the cut, as near as in the tracks; off in the
    paper."""
    cut_faces: bool = True
    """In a rollout a blade narrows the Gaussians that it passes, so that none reaches across the cut; off in the
    paper."""
    width: int = 24
    """Channels of particles and of the finest grid."""
    cells_across: float = 8.0
    """Grid cells along the object's longest extent."""
    resample: bool = True
    """Merge and split Gaussians."""
    merge_below: float = 0.05
    """Opacity under which a Gaussian merges into its neighbour [-]."""
    split_above: float = 20.0
    """Ratio of longest to shortest axis above which a Gaussian splits [-]; `fit-init` makes them up to 12."""
    resampling_form: Literal["moments", "paper"] = "moments"
    """Merging and splitting that keep the moments, or Eq. 27-28 as printed."""
    track_weight: float = 1.0
    """Weight of the distance to the track, per 0.1 m [-]."""
    image_weight: float = 1.0
    """Weight of the rendering loss in the second phase [-]."""
    rigid_weight: float = 1.0
    """Lambda_r of the rigidity term, per 0.1 m [-]."""
    rotation_weight: float = 0.05
    """Lambda_rot of the rotation term [-]."""
    isometry_weight: float = 1.0
    """Lambda_i of the isometry term, per 0.1 m [-]."""
    sever: bool = True
    """A blade severs neighbours in those terms; the paper keeps them."""
    ssim_weight: float = 0.1
    """Lambda_SSIM [-]."""
    l1_weight: float = 0.9
    """Lambda_L1 [-]."""
    depth_weight: float = 0.2
    """Lambda_depth, per `length_unit_m` [-]."""
    mask_weight: float = 0.1
    """Weight of the silhouette [-]; 0 in the paper."""
    length_unit_m: float = 0.1
    """Length that counts as 1 in the loss [m]; 1 in the paper, whose scenes have other units."""
    filter_iterations: int = 40
    """Gradient steps a frame of the filter that makes the tracks."""
    folds: int = 0
    """Models trained besides, each without its share of the episodes (2 or more; 0: none), so that `diagnose` can tell
    how far the model is off in episodes that it has not seen."""
    made_up: int = 24
    """Episodes that the engine makes up, where one is given."""
    made_up_reach: float = 1.6
    """Largest factor of the recorded ways along the table in made-up episodes; the smallest is 0.5 [-]."""
    made_up_speed: float = 1.4
    """Largest factor of the recorded speeds in made-up episodes; the smallest is its inverse [-]."""
    made_up_turn_deg: float = 20.0
    """Largest turn of a made-up motion about the vertical [degrees]."""
    device: str = "auto"
    """Where it runs: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Tracks that are made at a time, made-up ones as well, each in a process; -1 is one a core. On a GPU one after
    the other."""


def check_settings(config: TrainConfig) -> None:
    """Refuse settings out of range, by name.

    Raises:
        PlopError: One is.
    """
    weights = ("track", "image", "rigid", "rotation", "isometry", "ssim", "l1", "depth", "mask")
    check_jobs(config, "train")
    check_ranges(
        config,
        "train",
        {
            "track_steps": (0, inf),
            "image_steps": (0, inf),
            "batch": (1, inf),
            "horizon": (1, inf),
            "learning_rate": (0, 1),
            "averaging": (0, 1),
            "noise_m": (0, 1),
            "validate_every": (1, inf),
            "checkpoint_every": (1, inf),
            "width": (2, 4096),
            "cells_across": (1, 256),
            "merge_below": (0, 1),
            "folds": (0, inf),
            "made_up": (0, inf),
            "made_up_reach": (0, 10),
            "made_up_speed": (1, 10),
            "made_up_turn_deg": (0, 180),
            "split_above": (1, inf),
            "length_unit_m": (1e-6, inf),
            "filter_iterations": (0, inf),
            **{f"{name}_weight": (0, inf) for name in weights},
        },
    )
    if config.track_steps + config.image_steps < 1:
        raise PlopError(
            "There is nothing to train.",
            where="train.track_steps, train.image_steps",
            expected="at least one step",
            found="0 and 0",
        )
