"""Simulated training episodes: tracks of plausible motions that were not recorded.

A network does not extrapolate to motions outside its training set, such as pushes farther or faster than the recorded
ones, or another orientation of the blade. An engine fitted to the same recordings does. Each simulated episode starts
with the fitted Gaussians of a recorded one; the engine moves them under a varied motion of the tool.

One file per episode, made-up/<name>.h5: a track (see `stages.train.tracks`) with the tool's motion and its states.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Fits, Model
from plop.dynamics.episodes import Actions
from plop.dynamics.initial_surface import initial_surface
from plop.dynamics.interface import at_rest
from plop.dynamics.rollout import predict
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.trajectory import TrajectoryWriter
from plop.geometry.meshes.tool import ToolGeometry
from plop.models import load_model
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.varied_motion import another_motion
from plop.pipeline.stage import Output
from plop.recordings.set import RecordingSet
from stages.train.settings import TrainConfig
from stages.train.tracks import append_state


@dataclass(frozen=True)
class SimulatedEpisode:
    """One episode to simulate."""

    number: int
    recorded: str
    """Name of the recorded episode whose object, tool and motion it varies."""

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.recorded}-{self.number}"


def simulate_episodes(
    recordings: RecordingSet, init: Path, engine: Path, config: TrainConfig, out: Output
) -> tuple[list[SimulatedEpisode], list[str]]:
    """Simulate variations of the training episodes in turn; existing ones are kept.

    Args:
        recordings: Their training episodes are varied.
        init: Folder of `<episode>/object.ply`, fitted Gaussians of the first frame.
        engine: Folder of an engine's model.
        config: Number, ranges of variation, and seed.
        out: Receives made-up/; <name>.json instead of <name>.h5 if the engine failed, with the reason.

    Returns:
        The simulated episodes, and a warning if some failed.
    """
    names = list(recordings.train)
    episodes = [SimulatedEpisode(number, names[number % len(names)]) for number in range(config.made_up.episodes)]
    by_name = {episode.name: episode for episode in episodes}
    work = partial(_make_one_up, by_name, recordings, init, engine, config)
    done = out.map(list(by_name), work, jobs=config.jobs, of="made-up")
    followed = [episode for episode in episodes if done.values[episode.name]]
    lost = len(episodes) - len(followed)
    return followed, [f"the engine failed in {lost} of {len(episodes)} simulated episodes"] if lost else []


def _make_one_up(
    episodes: Mapping[str, SimulatedEpisode],
    recordings: RecordingSet,
    init: Path,
    engine: Path,
    config: TrainConfig,
    name: str,
    out: Output,
) -> bool:
    """Simulate one episode; return whether the engine succeeded."""
    episode, model = episodes[name], engine_model(engine)
    initial = read_splat(Fits(init).episode(episode.recorded).object_splat)
    with recordings.open(episode.recorded) as recording:
        mesh, height = recording.tool_mesh, recording.table_z_m
        recorded = ToolMotion(mesh.vertices, mesh.faces, recording.time_s, recording.world_from_tool)
        start = at_rest(initial, initial_surface(recording, initial))
    generator = np.random.default_rng([config.seed, episode.number])
    motion = another_motion(recorded, initial.means.double().numpy(), config.made_up, generator)
    poses = torch.as_tensor(motion.world_from_tool, dtype=torch.float32)
    actions = Actions(ToolGeometry.from_mesh(mesh.vertices, mesh.faces), poses, motion.times, height)
    files = Model(out.path).made_up
    states = []
    try:
        for state, _ in predict(model, start, actions.steps(), episode.name, config.seed):
            states.append(state)
            out.progress(len(states), len(actions), f"simulate {episode.name}")
    except PlopError as error:
        write_json(files.innovation(name), {"not_followed": error.problem})
        return False
    with TrajectoryWriter(files.states(name)) as writer:
        for frame, state in enumerate(states):
            append_state(writer, frame, state, world_from_tool=poses[frame], time_s=np.array(motion.times[frame]))
    return True


def engine_model(folder: Path) -> FilledEngineModel:
    """Read the engine for simulated episodes; Gaussians keep their shapes, since a track has only those of frame 0.

    Raises:
        PlopError: The model is a learned one.
    """
    model = load_model(folder)
    if not isinstance(model, FilledEngineModel):
        raise PlopError(
            "Episodes can only be simulated with an engine.",
            where=folder,
            expected="a model of `plop identify`",
            found="a learned model",
            fix="Use the engine that was fitted to these recordings.",
        )
    return FilledEngineModel(model.base, model.effects)
