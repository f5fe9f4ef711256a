"""Predictions of a model for the tracked points of an episode."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.comparison.discretisations import predicted_by_each
from plop.comparison.engine_run import predict_points, start_particles
from plop.comparison.gaussian_lineage import follow_gaussians
from plop.dynamics.episodes import Actions
from plop.dynamics.i2n.model_io import read_facts
from plop.dynamics.interface import at_rest
from plop.dynamics.rollout import predict
from plop.gaussians.splat_ply import read_splat
from plop.models import effects_of, engine_of, innermost, load_model
from plop.physics.adapters.filled import EngineBase
from plop.recordings.recording import Recording
from plop.tracking.episode import Episode


def predict_episode(model_folder: Path, recording_path: Path, splat_path: Path, episode: Episode) -> np.ndarray:
    """Roll a model out from the first frame.

    Args:
        model_folder: Payload of `train`, `identify` or `augment`.
        recording_path: The recording, for the tool's motion.
        splat_path: Gaussians at the first frame.
        episode: The tracked points.

    Returns:
        Their predicted places, [T, M, 3] [m].

    Raises:
        PlopError: The model diverges.
    """
    engine = _engine_as_base(model_folder)
    if engine is not None:
        effects = effects_of(model_folder)
        run = predict_points(engine, episode, start_particles(engine, episode, effects), effects)
        # a settled object lies a little deeper in the grid than it was measured
        return np.asarray(episode.points[0] + run - run[0])
    model, first = load_model(model_folder), read_splat(splat_path)
    with Recording.open(recording_path) as recording:
        actions = Actions.of(recording)
    states = predict(model, at_rest(first, (episode.vertices, episode.faces)), actions.steps(), episode.name, seed=0)
    return np.stack([follow_gaussians(first, state.gaussians, episode.points[0]) for state, _ in states])


def predictions_of(model_folder: Path, recording_path: Path, splat_path: Path, episode: Episode) -> list[np.ndarray]:
    """Do the same, for an engine in each discretisation; see `predict_episode`.

    Returns:
        The predicted places, [T, M, 3] [m] each.
    """
    engine = _engine_as_base(model_folder)
    if engine is not None:
        return predicted_by_each(engine, episode, effects_of(model_folder))
    return [predict_episode(model_folder, recording_path, splat_path, episode)]


def _engine_as_base(model_folder: Path) -> EngineBase | None:
    """Find the engine of a model that is one, with or without effects."""
    engine = engine_of(model_folder)
    return engine if engine is not None and read_facts(innermost(model_folder)).get("kind") == "engine" else None
