"""The benchmark of the peers: its data, its rivals and its tables."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from benchmarks.peers.__main__ import _note, main, parsed
from benchmarks.peers.particle_data import FEATURES, ParticleRollout, read_rollouts
from benchmarks.peers.particle_models import MODELS, Moment, Units, open_loop, stepped
from benchmarks.peers.particle_rivals import rivals
from benchmarks.peers.particles import ParticlePlan, carry_out, errors, split, unrolled_loss
from benchmarks.peers.scaling import measured
from benchmarks.peers.score import particle_tables, read_rows, scaling_to_markdown, table_to_markdown
from benchmarks.peers.strips import _sheet
from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.render.pictures.panels import PANEL

FRAMES, COUNT, FALL_M = 9, 20, 0.01


def falling(seed: int, shapes: int = 0) -> np.ndarray:
    """Particles that fall at constant speed; shapes that move sideways."""
    rng = np.random.default_rng(seed)
    start = rng.random((COUNT + shapes, 3)) * 0.3 + [0, 1, 0]
    step = np.full((COUNT + shapes, 3), [0, -FALL_M, 0])
    step[COUNT:] = [0.002, 0, 0]
    return (start + np.arange(FRAMES)[:, None, None] * step).astype(np.float32)


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "data" / "FluidFall"
    folder.mkdir(parents=True)
    for k in range(4):
        np.savez(folder / f"valid_{k}.npz", positions=falling(k))
    np.savez(folder / "stat.npz", positions=np.zeros((3, 3)))
    return tmp_path / "data"


def rollout(seed: int = 0, shapes: int = 0, rigid: int = 0) -> ParticleRollout:
    places = torch.from_numpy(falling(seed, shapes))
    return ParticleRollout(f"valid_{seed}", places[:, :COUNT], None, places[:, COUNT:], rigid)


def test_rollouts_are_read_as_they_are_packed(tmp_path, data):
    found = read_rollouts(data, "FluidFall")
    assert [each.name for each in found] == [f"valid_{k}" for k in range(4)]
    assert torch.equal(found[1].positions, torch.from_numpy(falling(1))) and found[0].rest is None
    grip = tmp_path / "data" / "RiceGrip"
    grip.mkdir()
    both = np.concatenate([falling(5, 2) * 0 + 7, falling(5, 2)], axis=2)
    for k in range(3):
        np.savez(grip / f"valid_{k}.npz", positions=both, shape_quats=np.zeros((FRAMES, 2, 4)))
    found = read_rollouts(tmp_path / "data", "RiceGrip")[0]
    assert len(found) == FRAMES - 1 and found.shapes.shape == (FRAMES - 1, 2, 3)  # frame 0 is skipped
    assert torch.equal(found.positions[0], torch.from_numpy(falling(5, 2))[1, :COUNT])
    assert (found.rest == 7).all()


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"velocities": falling(0)}, "cannot be read"),
        ({"positions": falling(0)[0]}, "another form"),
        ({"positions": falling(0) * np.nan}, "another form"),
        ({"positions": np.array([{}])}, "cannot be read"),
    ],
)
def test_bad_files_are_errors_in_words(data, content, problem):
    np.savez(data / "FluidFall" / "valid_0.npz", **content)
    with pytest.raises(PlopError, match=problem):
        read_rollouts(data, "FluidFall")


def test_bad_folders_are_errors_in_words(data, tmp_path, capsys):
    with pytest.raises(PlopError, match="too few rollouts") as error:
        read_rollouts(data, "FluidShake")
    assert "FluidFall" in error.value.expected
    with pytest.raises(PlopError, match="too few rollouts"):
        read_rollouts(tmp_path / "none", "FluidFall")
    parsed(["run", "particles"])
    import sys

    argv, sys.argv = sys.argv, ["peers", "run", "particles", "--work", str(tmp_path)]
    try:
        assert main() == 1 and "data are not named" in capsys.readouterr().err
        sys.argv = ["peers", "score", "--work", str(tmp_path), "--result", str(tmp_path / "none.json")]
        assert main() == 1 and "nothing to score" in capsys.readouterr().err
        sys.argv = ["peers", "tables", "--result", str(tmp_path / "none.json")]
        assert main() == 1 and "not a result" in capsys.readouterr().err
    finally:
        sys.argv = argv


@pytest.mark.parametrize("option", ["--horizon", "--steps", "--jobs", "--rounds", "--counts"])
def test_a_count_is_at_least_one(option, capsys):
    with pytest.raises(SystemExit):
        parsed(["run", "particles", option, "0"])
    assert f"{option}: at least 1, not 0" in capsys.readouterr().err


@pytest.mark.parametrize("shapes", [0, 2, 5])
def test_features_do_not_depend_on_the_place_in_the_room(shapes):
    one = rollout(shapes=shapes)
    now, before = one.positions[2], one.positions[1]
    features = one.features(2, now, before, 0.01)
    assert features.shape == (COUNT, FEATURES) and torch.isfinite(features).all()
    shift = torch.tensor([0.7, 0.0, -0.4])
    moved = ParticleRollout("moved", one.positions + shift, None, one.shapes + shift, 0)
    torch.testing.assert_close(moved.features(2, now + shift, before + shift, 0.01), features, rtol=0, atol=1e-4)


def test_an_untrained_network_holds_the_velocity_and_a_rigid_body_keeps_its_shape():
    one, units = rollout(rigid=6), Units(0.01, 1e-6, 0.5)
    for make in MODELS.values():
        torch.manual_seed(0)
        found = open_loop(make(units), units, one)
        assert errors(found, one.positions)["mean_l2_mm"] < 0.1  # they fall at constant speed
    torch.manual_seed(0)
    network, coarse = MODELS["transformer"](units), Units(0.01, 1.0, 0.5)
    with torch.no_grad():
        moved = stepped(network, coarse, [Moment(one, 1, one.positions[1], one.positions[0])])[0].now
    before, after = (torch.cdist(each[:6], each[:6]) for each in (one.positions[0], moved))
    torch.testing.assert_close(before, after, rtol=0, atol=1e-5)
    assert float((moved[6:] - one.positions[2, 6:]).abs().max()) > 1e-4


def test_each_rival_is_what_it_says():
    one = rollout(0)
    found = rivals(one, [rollout(1), rollout(0), rollout(2)])
    error = {name: errors(each, one.positions) for name, each in found.items()}
    assert error["persistence"]["final_l2_mm"] == pytest.approx(1e3 * FALL_M * (FRAMES - 1), rel=1e-4)
    # Mean over frames 2 to 8 of k steps; one coordinate of three moves.
    assert error["persistence"]["mean_l2_mm"] == pytest.approx(1e3 * FALL_M * 5, rel=1e-4)
    squares = [(k * FALL_M) ** 2 / 3 for k in range(2, FRAMES)]
    assert error["persistence"]["mse_1e3_m2"] == pytest.approx(1e3 * sum(squares) / len(squares), rel=1e-4)
    assert max(error[name]["final_l2_mm"] for name in ("velocity", "replay", "rigid")) < 0.01


def test_no_scene_is_on_both_sides_of_a_split():
    rollouts = [rollout(k) for k in range(5)]
    pair = ("valid_0", "valid_1")
    for fold in range(5):
        test, chooser, training = split(rollouts, fold, pair)
        names = [test.name, chooser.name, *(each.name for each in training)]
        assert test.name == f"valid_{fold}" and len(set(names)) == len(names) and len(training) >= 2
        parts = [{test.name}, {chooser.name}, {each.name for each in training}]
        assert sum(bool(part & set(pair)) for part in parts) == 1


def test_a_stopped_run_goes_on_and_is_scored(data, tmp_path):
    plan = ParticlePlan(data, "FluidFall", (0, 1), (0,), seconds=0.05, validations=2)
    carry_out([plan], tmp_path)
    rows = read_rows(tmp_path)
    assert len(rows) == 2 * (4 + len(MODELS))
    path = next((tmp_path / "rows").glob("*transformer-1-0.json"))
    others = {each: each.stat().st_mtime_ns for each in (tmp_path / "rows").iterdir() if each != path}
    path.unlink()
    carry_out([plan], tmp_path)
    assert path.is_file() and all(each.stat().st_mtime_ns == time for each, time in others.items())
    tables, facts = particle_tables(read_rows(tmp_path))
    table = tables["FluidFall"]
    assert set(table) == {*MODELS, "persistence", "velocity", "replay", "rigid"}
    cell = table["i2n"]["mean_l2_mm"]
    each = [row["errors"]["mean_l2_mm"] for row in rows if row["model"] == "i2n"]
    assert cell["mean"] == pytest.approx(sum(each) / 2, rel=1e-3) and cell["n"] == 2 and cell["seeds"] == [0]
    assert table["rigid"]["mean_l2_mm"]["seeds"] == []
    sizes = {facts["FluidFall"][name]["parameters"] for name in MODELS}
    assert max(sizes) < 1.03 * min(sizes)  # equal networks
    assert "(oracle)" in table_to_markdown(table, {"mean_l2_mm": "L2"})


def test_the_same_seed_draws_the_same_windows(data):
    rollouts, plan = read_rollouts(data, "FluidFall"), ParticlePlan(data, "FluidFall", (0,), (0,), 1.0)
    units, losses = Units.of(rollouts), []
    for _ in range(2):
        torch.manual_seed(0)
        network = MODELS["dpi-net"](units)
        losses.append(float(unrolled_loss(network, units, rollouts, plan, np.random.default_rng(3)).detach()))
    assert losses[0] == losses[1]


@pytest.mark.parametrize(("horizon", "error"), [(1, 1.0), (3, (1 + 1.5**2 + 2**2) / 3)])
def test_an_unrolled_loss_sees_a_constant_error_grow(data, horizon, error):
    """Particles fall at constant speed: a wrong change c in every frame is k (k + 1) / 2 c after k frames."""
    rollouts = read_rollouts(data, "FluidFall")
    plan = ParticlePlan(data, "FluidFall", (0,), (0,), 1.0, horizon=horizon, batch=2, noise=0)
    wrong = torch.nn.Parameter(torch.tensor(0.7))

    def network(positions, _features):
        return [wrong.expand_as(each) for each in positions]

    loss = unrolled_loss(network, Units(0.01, 0.01, 0.5), rollouts, plan, np.random.default_rng(0))
    assert float(loss.detach()) == pytest.approx(error * 0.7**2, rel=1e-3)
    loss.backward()
    assert float(wrong.grad) == pytest.approx(2 * error * 0.7, rel=1e-3)


def test_the_gradient_goes_through_a_rigid_body():
    one, units = rollout(rigid=6), Units(0.01, 0.01, 0.5)
    change = torch.zeros(COUNT, 3, requires_grad=True)
    moment = Moment(one, 1, one.positions[1], one.positions[0])
    for _ in range(2):
        moment = stepped(lambda *_: [change], units, [moment])[0]
    moment.now.square().sum().backward()
    assert change.grad is not None and bool((change.grad.abs().sum(1) > 0).all())


def test_scaling_says_what_was_left_out_and_why():
    found = measured((60, 4000), limit_s=60, memory_gb=1.0, rounds=1)
    dense = found["dpi-net, dense"]
    assert dense["60"]["forward_ms"] > 0 and "GB" in dense["4000"]["left_out"]
    assert found["i2n"]["4000"]["training_ms"] > 0
    text = scaling_to_markdown(json.loads(json.dumps(found)))
    assert "4,000" in text and "more than 1 GB" in text


def test_a_strip_shows_object_and_tool_on_paper():
    camera = Camera("c0", 16, 12, np.array([[20.0, 0, 8], [0, 20, 6], [0, 0, 1]]), np.eye(4))
    mask = np.zeros((12, 16), np.uint8)
    mask[3:9, 4:12] = MaskLabel.OBJECT
    view = View(camera, np.full((12, 16, 3), 7, np.uint8), np.ones((12, 16), np.float32), mask)
    picture = _sheet([[view] * 3] * 2, ["t = 0", "t = 1"], ["measured", "PLOP", "engine"])
    colours = {tuple(map(int, colour)) for colour in picture.reshape(-1, 3)}
    assert picture.shape[0] % 2 == 0 and PANEL in colours and (7, 7, 7) in colours


def test_a_command_is_noted_without_folders(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["peers", "run", "pipeline", "--data=/a/b", "--work", "/c d", "--steps", "150"])
    _note(tmp_path, "noted", {})
    command = json.loads((tmp_path / "noted.json").read_text())["command"]
    assert command == "python -m benchmarks.peers run pipeline --data FOLDER --work FOLDER --steps 150"
