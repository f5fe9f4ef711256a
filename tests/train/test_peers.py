"""Each peer goes the whole way, train, rollout and eval, and its files say what it is."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file

from plop.artifacts.layouts import Model
from plop.dynamics.episodes import Actions
from plop.dynamics.filter.particle_filter import UpdateConfig
from plop.dynamics.i2n.network import I2NConfig
from plop.dynamics.learned import DynamicsName, parameter_count, untrained
from plop.dynamics.losses.physical import Neighbourhood
from plop.dynamics.peers.model import PeerConfig
from plop.dynamics.peers.settings import GraphConfig, PeerSettings, TransformerConfig
from plop.errors import PlopError
from plop.gaussians.splat_ply import write_splat
from plop.models import load_model
from plop.pipeline.stage import Input, Output
from plop.render.losses import RenderWeights
from stages.eval.stage import STAGE, EvalConfig
from stages.rollout.stage import RolloutConfig
from stages.rollout.stage import run as roll_out
from stages.train.checkpoints import load_checkpoint
from stages.train.form import model_config
from stages.train.objective import TrainingStep
from stages.train.optimise import averaged_model
from stages.train.settings import LossWeights, TrainConfig
from stages.train.stage import run
from stages.train.tracks import Track
from stages.train.windows import Window
from tests.dynamics.conftest import blade
from tests.support.block_scene import grid_gaussians
from tests.support.small_episode import FRAMES, coloured_block, poses, truth, write_set

PEERS = [name for name in get_args(DynamicsName) if name != "i2n"]
SMALL = TrainConfig(
    track_steps=30,
    image_steps=2,
    batch=2,
    horizon=2,
    learning_rate=5e-3,
    averaging=0.5,
    network=I2NConfig(width=4, cells_across=4),
    peers=PeerSettings(
        gs_dynamics=GraphConfig(particles=30, tool_points=12, width=16),
        dpi_net=GraphConfig(particles=40, tool_points=12, width=16, propagations=2, bones=4),
        transformer=TransformerConfig(particles=40, tool_points=12, width=16, heads=2, layers=2, bones=4),
    ),
    update=UpdateConfig(iterations=2),
    validate_every=16,
    jobs=1,
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    recordings, init = write_set(tmp_path_factory.mktemp("set"))
    tool = grid_gaussians((0.002, 0.08, 0.04), 0.008, colour_seed=None)
    for folder in init.iterdir():
        write_splat(folder / "tool.ply", tool)
    return {"recordings": Input(recordings), "init": Input(init)}


@pytest.fixture(scope="module")
def trained(inputs, tmp_path_factory):
    folders = {}
    for name in PEERS:
        folders[name] = tmp_path_factory.mktemp(name)
        run(inputs, replace(SMALL, dynamics=name), Output(folders[name]))
    return folders


@pytest.mark.parametrize("name", PEERS)
def test_train_rollout_eval(name, trained, inputs, tmp_path):
    folder = trained[name]
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    steps = [line for line in lines if "track" in line]
    assert len(steps) == SMALL.steps and steps[-1]["splits"] == steps[-1]["merges"] == 0 and "image" in steps[-1]
    (tmp_path / "rollout").mkdir()
    roll_out(inputs | {"model": Input(folder)}, RolloutConfig(jobs=1), Output(tmp_path / "rollout"))
    (tmp_path / "eval").mkdir()
    scored = inputs | {"rollouts": Input(tmp_path / "rollout"), "tracks": Input(folder)}
    STAGE.run(scored, EvalConfig(method=name, emd_every=0, jobs=1), Output(tmp_path / "eval"))
    report = json.loads((tmp_path / "eval" / "scores.json").read_text())
    assert {name, "persistence", "rigid", "replay"} == set(report["methods"])
    assert report["methods"][name]["end"]["cd_mm"]["mean"] < 20


def exact_track() -> Track:
    """The true motion of the block: three steps in which nothing moves, then the blade pushes one half."""
    block = coloured_block(120)
    states = truth(block)
    means, none = torch.stack([state.means for state in states]), torch.zeros(FRAMES, 120)
    moves = torch.cat([torch.zeros(1, 120, 3), means.diff(dim=0)])
    actions = Actions(blade(), poses(), 0.04 * np.arange(FRAMES), 0.0)
    pairs = Neighbourhood.of(means[0])
    quats, opacities = block.quats.expand(FRAMES, -1, -1), block.opacities.expand(FRAMES, -1)
    return Track("exact", None, block, means, quats, opacities, moves, torch.zeros_like(moves), none, actions, pairs)


@pytest.mark.parametrize("name", PEERS)
def test_the_objective_teaches_a_motion(name):
    torch.manual_seed(0)
    plan, track = replace(SMALL, dynamics=name), exact_track()
    model = untrained(model_config(plan, [track]))
    step, windows = TrainingStep(model), [Window(0, 3, 2, (False, False), 0, (0, 0))]
    optimiser = torch.optim.AdamW(model.parameters(), lr=3e-3)
    errors = []
    for _ in range(80):
        loss, log = step(windows, [track], LossWeights(image=0), RenderWeights(), 0.0)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        errors.append(log["track"])
    # Blending all control points, as gs-dynamics does, cannot part the halves sharply.
    assert min(errors) < {"gs-dynamics": 0.8}.get(name, 0.5) * errors[0]


@pytest.mark.parametrize("name", PEERS)
def test_the_same_seed_gives_the_same_weights(name, trained, inputs, tmp_path):
    run(inputs, replace(SMALL, dynamics=name), Output(tmp_path))
    one, again = load_file(trained[name] / "model.safetensors"), load_file(tmp_path / "model.safetensors")
    assert all(torch.equal(value, again[key]) for key, value in one.items())


@pytest.mark.parametrize("name", PEERS)
def test_the_files_name_the_dynamics_and_give_the_model_back(name, trained):
    folder = trained[name]
    facts = json.loads(Model(folder).facts.read_text())
    assert facts["kind"] == facts["config"]["dynamics"] == name
    with safe_open(Model(folder).weights, framework="pt") as file:
        assert file.metadata()["kind"] == name
    model = load_model(folder)
    assert model.kind == name and model.config.network == SMALL.peers.of(name)


def edited(folder, target, **changes):
    shutil.copytree(folder, target)
    facts = json.loads(Model(target).facts.read_text()) | changes
    Model(target).facts.write_text(json.dumps(facts))
    return target


def test_an_unknown_dynamics_is_an_error_in_words(trained, tmp_path):
    folder = edited(trained["dpi-net"], tmp_path / "odd", kind="gns")
    with pytest.raises(PlopError, match="unknown kind") as error:
        load_model(folder)
    assert "gs-dynamics" in str(error.value.expected) and error.value.found == "gns"


def test_weights_of_another_dynamics_are_an_error_in_words(trained, tmp_path):
    mixed = edited(trained["dpi-net"], tmp_path / "mixed")
    shutil.copy(Model(trained["gs-dynamics"]).weights, Model(mixed).weights)
    with pytest.raises(PlopError, match="another dynamics") as error:
        load_model(mixed)
    assert (error.value.expected, error.value.found) == ("dpi-net", "gs-dynamics")


def test_a_checkpoint_of_another_dynamics_is_an_error_in_words(inputs, tmp_path):
    class Stopped(Exception):
        pass

    def stop(done, total, label="", **figures):
        if label.startswith("train") and done == 28:
            raise Stopped

    with pytest.raises(Stopped):
        run(inputs, replace(SMALL, dynamics="gs-dynamics"), Output(tmp_path, stop))
    model = untrained(PeerConfig("dpi-net", SMALL.peers.gs_dynamics))
    with pytest.raises(PlopError, match="checkpoint is of another dynamics") as error:
        load_checkpoint(tmp_path, model, averaged_model(model, 0.5), torch.optim.AdamW(model.parameters()))
    assert (error.value.expected, error.value.found) == ("dpi-net", "gs-dynamics")


def test_settings_that_no_network_can_have_are_refused():
    with pytest.raises(PlopError, match="invalid value"):
        TrainConfig(dynamics="gns")
    with pytest.raises(PlopError, match="shared among its heads"):
        TransformerConfig(width=30, heads=4)


def test_the_defaults_have_as_many_parameters_as_the_model():
    from plop.dynamics.i2n.model import PlopConfig

    own = parameter_count(untrained(PlopConfig()))
    for name in PEERS:
        other = parameter_count(untrained(PeerConfig(name, PeerSettings().of(name))))
        assert other == pytest.approx(own, rel=0.02)
