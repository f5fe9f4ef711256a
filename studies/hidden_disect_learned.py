"""The hidden DiSECt sets with a learned base: `python -m studies.hidden_disect_learned --data DATA`.

I2N learns from followed points (no cameras; they are its particles): the recordings that the engine of
`studies.hidden_disect` was fitted to, two plain cuts, and cuts and pushes that this engine makes up, since six
recordings do not reach as far as the sets do. The engine computes the responses. How far the learned base is off in
recordings that it has not seen is told by two models that learned without one half of the recordings each.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from plop.diagnosis.responses import Job
from plop.diagnosis.runs import Runs
from plop.diagnosis.table import Measured
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.i2n.network import I2NConfig
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.resampling import ResamplingConfig
from plop.geometry.rigid import pose_from_euler_xyz
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.tool_motion import ToolMotion
from plop.pipeline.execute import versions
from plop.tracking.episode import Episode
from stages.train.settings import TrainConfig
from studies.hidden_disect import SETS, answers_of, episodes_of, reference_of, run_set, run_sets
from studies.physics_learned import predicted, rms_m, track_of, train_once
from stages.train.settings import LossWeights, TrainConfig

MADE_UP, SEED = 24, 7
"""Episodes that the engine makes up, and the seed of their motions."""
SEEN_TWICE = 2
"""How often a recording counts beside the made-up ones."""
NEIGHBOURS = 10
"""Points over which the noise of a followed point is averaged out."""
DOWN_STEPS = 20
"""Frames of a cut, as in the recordings."""
DOWN_M_S, PUSH_M_S, PUSH_M = (0.048, 0.092), (0.05, 0.115), (0.008, 0.042)
"""Ranges of the made-up speeds and ways; somewhat wider than those of both data sets."""
ASIDE_M, TURN_RAD = (0.014, 0.006), np.radians(20)
"""How far from the object's middle a made-up cut begins, along the table's x and y, and how far the blade is turned."""
TRAINING = TrainConfig(
    track_steps=1500,
    image_steps=0,
    horizon=8,
    resampling=ResamplingConfig(enabled=False),
    network=I2NConfig(features="oriented"),
    device="cpu",
    weights=LossWeights(rigid=0.1, isometry=0.1, rotation=0.0),
)
"""Tracks without noise need little help by what nearly holds: a soft object that sags does not keep its lengths."""


def main() -> None:
    """Train three models, diagnose all sets, then score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=Path("artifacts/.hidden-disect-learned"))
    parser.add_argument(
        "--engine-work",
        type=Path,
        default=Path("artifacts/.hidden-disect"),
        help="Folder of `studies.hidden_disect`, whose engine is taken.",
    )
    parser.add_argument("--out", type=Path, default=Path("docs/results/hidden_disect_learned.json"))
    parser.add_argument("--jobs", type=int, default=-1)
    options = parser.parse_args()
    for folder in (options.work, options.engine_work):
        folder.mkdir(parents=True, exist_ok=True)
    recordings, engine, odd = reference_of(options.data, options.engine_work, options.jobs)
    plain = episodes_of(options.data / "disect", "prism_jelly_00*")
    made_up = made_up_by(engine, recordings, Runs(options.engine_work / "jobs", jobs=options.jobs))

    model = learned(options.work / "model", recordings, plain, made_up)
    unseen = dict[str, np.ndarray]()
    for half in (0, 1):
        judge = learned(options.work / f"half_{half}", recordings[1 - half :: 2], plain, made_up)
        unseen |= {episode.name: predicted(judge, episode) for episode in recordings[half::2]}

    def measured(episodes: list[Episode]) -> Measured:
        return Measured(episodes, {e.name: [predicted(model, e)] for e in episodes})

    known = Measured(recordings, {name: [points] for name, points in unseen.items()})
    rows = run_sets(
        SETS,
        options.work,
        lambda name: run_set(name, options.data, known, engine, options.engine_work, options.jobs, measured),
    )
    facts = {
        "command": "python -m studies.hidden_disect_learned --data DATA",
        "versions": versions(),
        "seeds": [TRAINING.seed, SEED],
        "left_out": odd,
        "unseen_rms_mm": {e.name: 1000 * rms_m(e, unseen[e.name]) for e in recordings},
        "seen_rms_mm": {e.name: 1000 * rms_m(e, predicted(model, e)) for e in recordings},
        "sets": rows,
        "answers": answers_of(options.data),
    }
    options.out.write_text(json.dumps(facts, indent=1))


def learned(folder: Path, recordings: list[Episode], plain: list[Episode], made_up: list[Episode]) -> PlopModel:
    """Train I2N on recordings, plain cuts and made-up episodes, once."""
    episodes = [calmed(episode) for episode in (*recordings, *plain)] * SEEN_TWICE + made_up
    return train_once(folder, lambda: [track_of(episode) for episode in episodes], TRAINING, "prism-jelly", threads=1)


def made_up_by(engine: EngineBase, recordings: Sequence[Episode], runs: Runs) -> list[Episode]:
    """Let the engine carry out cuts and pushes that were not recorded; what it cannot follow is left out."""
    generator = np.random.default_rng(SEED)
    planned = [another_motion(recordings[k % len(recordings)], f"made_up_{k}", generator) for k in range(MADE_UP)]
    answers = runs([Job(episode, engine) for episode in planned])
    return [
        replace(episode, points=answer.points)
        for episode, answer in zip(planned, answers, strict=True)
        if answer.points is not None
    ]


def another_motion(episode: Episode, name: str, generator: np.random.Generator) -> Episode:
    """Plan another cut and push with an episode's tool and object, which has yet to be carried out."""
    first = episode.tool.world_from_tool[0]
    start, end = first[2, 3], episode.tool.world_from_tool[:, 2, 3].min()
    turn = generator.choice([0.0, generator.uniform(-TURN_RAD, TURN_RAD)])
    aside = [generator.uniform(-most, most) for most in ASIDE_M]
    down, speed, way = (generator.uniform(*most) for most in (DOWN_M_S, PUSH_M_S, PUSH_M))
    step_s = (start - end) / down / DOWN_STEPS
    steps = max(3, round(way / speed / step_s))
    push = generator.choice([-1.0, 1.0]) * way * np.array([np.cos(turn), np.sin(turn), 0])
    cut = np.linspace([0, 0, start], [0, 0, end], DOWN_STEPS + 1)
    places = np.concatenate([cut, cut[-1] + np.linspace(push / steps, push, steps)])
    places[:, :2] += episode.points[0].mean(0)[:2] + aside
    turned = pose_from_euler_xyz(np.array([0, 0, 0, 0, 0, turn - np.arctan2(first[1, 0], first[0, 0])])) @ first
    poses = np.tile(turned, (len(places), 1, 1))
    poses[:, :3, 3] = places
    times = step_s * np.arange(len(places))
    tool = ToolMotion(episode.tool.vertices, episode.tool.faces, times, poses)
    return replace(episode, name=name, times=times, points=np.tile(episode.points[:1], (len(times), 1, 1)), tool=tool)


def calmed(episode: Episode) -> Episode:
    """Average the motion of each point over those that begin and end beside it: noise is not motion."""
    moved = episode.points - episode.points[0]
    both_ends = np.concatenate([episode.points[0], moved[-3:].mean(0)], 1)
    _, near = cKDTree(both_ends).query(both_ends, k=NEIGHBOURS)
    return replace(episode, points=episode.points[0] + moved[:, near].mean(2))


if __name__ == "__main__":
    main()
