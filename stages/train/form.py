"""The model's configuration from the settings, and its units from the training set."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from plop.artifacts.layouts import Fits
from plop.dynamics.cohesion import natural_strays_m
from plop.dynamics.i2n.model import PlopConfig
from plop.dynamics.learned import LearnedConfig
from plop.dynamics.peers.model import PeerConfig
from plop.dynamics.resampling import ResamplingConfig
from plop.dynamics.rest import RestPlaces
from stages.train.settings import TrainConfig
from stages.train.tracks import Track

_FRAMES_MEASURED = 5
"""Frames of a track, including the first, for measuring the cohesion of its Gaussians."""
_KEPT = 0.9
"""Quantile of the cohesion limit over episodes: a press deforms more than a cut and must not be restricted."""


def model_config(config: TrainConfig, tracks: list[Track]) -> LearnedConfig:
    """Measure the units of the model's inputs and outputs on the training set."""
    length = max(float((t.means[0].amax(0) - t.means[0].amin(0)).max()) for t in tracks)
    square = sum(_mean_square_motion(t) for t in tracks) / len(tracks)
    motion = max(square**0.5, 1e-4 * length)
    if config.dynamics != "i2n":
        size = config.peers.of(config.dynamics)
        return PeerConfig(config.dynamics, size, frame=config.frame, length_m=length, motion_m=motion)
    return PlopConfig(
        network=config.network,
        resampling=thresholds(config.resampling, tracks),
        frame=config.frame,
        coupled=config.coupled,
        length_m=length,
        motion_m=motion,
        stray_m=stray_m(tracks) if config.cohesion else None,
        cut_faces=config.cut_faces,
    )


def thresholds(config: ResamplingConfig, tracks: list[Track]) -> ResamplingConfig:
    """Measure the thresholds on the fitted Gaussians, where shares of them are given."""
    fitted = [track.initial for track in tracks]
    if config.split_share > 0:
        elongation = torch.cat([g.scales.amax(1) / g.scales.amin(1) for g in fitted]).cpu().numpy()
        config = replace(config, split_above=max(1.0, float(np.quantile(elongation, 1 - config.split_share))))
    if config.merge_share > 0:
        opacities = torch.cat([g.opacities for g in fitted]).cpu().numpy()
        config = replace(config, merge_below=float(np.quantile(opacities, config.merge_share)))
    return config


def scene_scale(init: Path, episodes: list[str]) -> float | None:
    """Return the scene units per metre of fitted episodes, their median; None where `fit-init` had no scene."""
    facts = Fits(init).facts
    if not facts.is_file():
        return None
    scores = json.loads(facts.read_text())["episodes"]
    scales = [scores[name]["scene_scale"] for name in episodes if "scene_scale" in scores.get(name, {})]
    return float(np.median(scales)) if scales else None


def _mean_square_motion(track: Track) -> float:
    """Mean square of the Gaussians' motion in a step [m^2]; of the tool's where only the first frame is known."""
    if len(track) > 1:
        return float(track.means.diff(dim=0).square().sum(-1).mean())
    return float(track.actions.world_from_tool[:, :3, 3].diff(dim=0).square().sum(-1).mean())


def stray_m(tracks: list[Track]) -> float:
    """Measure the distance of Gaussians from the positions predicted by their neighbours [m].

    Nine of ten episodes satisfy it. Simulated episodes are used alone, if there are any: the others contain the
    filter's noise.
    """
    episodes = {track.name: track for track in tracks}.values()
    found = []
    for track in [track for track in episodes if track.recording_path is None] or episodes:
        frames = np.unique(np.linspace(0, len(track) - 1, _FRAMES_MEASURED).round().astype(int))[1:]
        found.append(natural_strays_m(RestPlaces(track.means[0]), track.means[frames], track.sides[frames]))
    return float(np.quantile(found, _KEPT))
