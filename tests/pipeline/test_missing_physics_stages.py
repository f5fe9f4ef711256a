"""The loop through its commands: identify, diagnose, augment, compare, report; then a second run executes nothing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from plop.artifacts.store import Store
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type
from plop.pipeline.execute import execute
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop_cli.app import main
from tests.pipeline.fake_stages import PiecesConfig
from tests.support.coarse_episodes import SCENE
from tests.support.tracked_set import write_recordings, write_tool_splats

EPISODES = 5
HIDDEN = effect_type("swelling")(rate_per_s=-0.6)
SETTINGS = """
[identify]
fit = ["table_friction"]
spacing_m = 0.010
start = "settled"
iterations = 1
jobs = 1

[identify.material]
youngs_modulus_pa = 15000.0
damping_per_s = 5.0

[compare]
frames = 0
pictures = false
jobs = 1

[diagnose]
effects = ["swelling"]
sensors = false
jobs = 1

[report]
frames = 2
episodes = 1
"""


def tracked(store: Store, name: str, number: int, effects: tuple[Effect, ...] = ()) -> list[str]:
    """Put recordings with Gaussians and exact tracks into a workspace; gives the options that name them."""
    parts = write_recordings(store.workspace / "written" / name, EPISODES, effects)
    write_tool_splats(parts["recordings"].path, parts["init"].path)
    options: list[str] = []
    for part, stage in {"recordings": "simulate", "init": "fit-init", "tracks": "filter"}.items():

        def copied(inputs: Inputs, config: PiecesConfig, out: Output, source: Path = parts[part].path) -> Summary:
            shutil.copytree(source, out.path, dirs_exist_ok=True)
            return Summary({"environment": SCENE.name})

        made_from = {given.removeprefix("--"): f"{name}-{given.removeprefix('--')}" for given in options[::2]}
        specs = {given: InputSpec(("simulate", "fit-init"), "") for given in made_from}
        execute(
            Stage(stage, 1, "", PiecesConfig, specs, copied),
            store=store,
            config=PiecesConfig(seed=number),
            inputs=made_from,
            name=f"{name}-{part}",
        )
        options += [f"--{part}", f"{name}-{part}"]
    return options


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> tuple[Store, list[list[str]]]:
    store = Store(tmp_path_factory.mktemp("loop"))
    (store.workspace / "plop.toml").write_text(SETTINGS)
    plain, mystery = tracked(store, "plain", 0), tracked(store, "mystery", 1, (HIDDEN,))
    reference = [
        option.replace("--", "--reference-").replace("-recordings", "") if option.startswith("--") else option
        for option in plain
    ]
    return store, [
        ["identify", *plain, "--name", "base"],
        ["diagnose", "--model", "base", *mystery, *reference, "--name", "verdict"],
        ["augment", "--model", "base", "--diagnosis", "verdict", "--name", "better"],
        *(["compare", "--model", model, *mystery, "--name", f"errors-{model}"] for model in ("base", "better")),
        [
            "report",
            "--models",
            "base,better",
            *mystery[:4],
            "--comparisons",
            "errors-base,errors-better",
            "--diagnoses",
            "verdict",
            "--evals",
            "none",
            "--labels",
            "base,better",
            "--name",
            "page",
        ],
    ]


def test_what_is_hidden_is_named_added_and_reported(commands, capsys):
    store, typed = commands
    for command in typed:
        assert main([*command, "-w", str(store.workspace)]) == 0, command
    verdict = json.loads((store.find("verdict").path / "diagnosis.json").read_text())["verdict"]
    assert (verdict["kind"], verdict["named"]) == ("EFFECT", ["swelling"]), verdict
    effect = json.loads((store.find("better").path / "model.json").read_text())["effects"][0]
    np.testing.assert_allclose(effect["parameters"]["rate_per_s"]["value"], HIDDEN["rate_per_s"], rtol=0.3)
    before, after = (
        json.loads((store.find(f"errors-{model}").path / "compare.json").read_text())["tables"]["all"][0]
        for model in ("base", "better")
    )
    assert after["rms_mm"] < 0.6 * before["rms_mm"]
    page = (store.find("page").path / "report.html").read_text()
    assert "What base is missing is swelling" in page and "None of these episodes was held out" in page
    assert page.count("plop compare --recordings") == 2 and "plop report --recordings" in page
    capsys.readouterr()
    for command in typed:
        assert main([*command, "-w", str(store.workspace)]) == 0
        assert "exists already, nothing to do" in capsys.readouterr().out, command
