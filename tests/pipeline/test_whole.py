"""`plop demo` and `plop reproduce`: all stages in one command, and nothing to do the second time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from plop.artifacts.store import Store
from plop.pipeline.chain import read_profile
from plop.pipeline.registry import stage_ref
from plop.pipeline.settings import resolve
from plop.recordings.readers.mesh.sequence import write_mesh_sequence
from plop_cli.app import main
from tests.pipeline.small_set import SMALL
from tests.support.box_sequence import box_sequence


def options(settings: list[str]) -> list[str]:
    return [part for setting in settings for part in ("--set", setting)]


def small_recordings(folder: Path, *, seed: int, progress: Any) -> None:
    for number in range(3):
        write_mesh_sequence(folder, box_sequence(f"demo_{number:03d}", frames=4, gap_m=0.02 + 0.002 * number))


def test_demo_ends_with_scores_a_video_and_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("plop.physics.scenes.demo.make_demo_recordings", small_recordings)
    cameras = ["ingest.mesh.cameras.size=40", "ingest.mesh.cameras.count=4"]
    command = ["demo", "-w", str(tmp_path), *options([*SMALL, *cameras])]
    assert main(command) == 0
    shown = capsys.readouterr().out
    for word in ("plop", "persistence", "rigid", "video.mp4", "still.png", "scores.json", "rollout", "all "):
        assert word in shown
    assert "kept" not in shown
    assert main(command) == 0
    assert capsys.readouterr().out.count("kept (took ") == 7
    assert main([*command, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert set(facts["seconds"].values()) == {0.0}
    assert all(Path(video).stat().st_size > 0 for video in facts["videos"] + facts["stills"])
    assert len(facts["videos"]) == len(facts["stills"]) == 1


def reproduce_small(shared_data: Path, folder: Path) -> tuple[list[str], Path]:
    """Give the command for one environment, two episodes and tiny images, and the folder its results go to."""
    docs = folder / "docs"
    docs.mkdir()
    settings = [
        *SMALL,
        "ingest.disect.cameras.size=32",
        "ingest.disect.cameras.count=3",
        "ingest.disect.cameras.supersample=1",
        "ingest.disect.episodes=*_part_00[04]",
    ]
    return [
        "reproduce",
        str(shared_data / "disect"),
        "--env",
        "prism-jelly",
        "-w",
        str(folder / "work"),
        "--out",
        str(docs),
        *options(settings),
    ], docs


def test_the_papers_own_forms_run_from_recordings_to_scores(shared_data: Path, tmp_path: Path):
    command, docs = reproduce_small(shared_data, tmp_path)
    own = ["train.track_steps=0", "train.epochs=2", "train.validation=0", "train.resampling.split_share=0.1"]
    assert main([*command, "-q", "--profile", "paper", *options(own)]) == 0
    results = json.loads((docs / "results" / "disect-paper.json").read_text())
    assert results["seeds"] == [0, 1, 2] and "--profile paper --env prism-jelly --set " in results["command"]
    trained = Store(tmp_path / "work").find("train@latest").manifest.config
    forms = trained["network"]["kernel"], trained["network"]["features"], trained["resampling"]["form"]
    assert forms == ("paper", "paper", "paper")
    rolled = Store(tmp_path / "work").find("rollout@latest").manifest.summary
    assert rolled["table"][0]["splits"] > 0


def test_reproduce_writes_the_results(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    command, docs = reproduce_small(shared_data, tmp_path)
    alone = [*command, "--profile", "cpu-recordings"]
    assert main([*alone, "-q"]) == 0
    first = docs / "results" / "disect-cpu-recordings.json"
    assert set(json.loads(first.read_text())["environments"]) == {"prism-jelly"}
    first.write_text(json.dumps(json.loads(first.read_text()) | {"date": "2020-01-01"}))
    capsys.readouterr()
    assert main(alone) == 0
    assert capsys.readouterr().out.count("exists already") == 7
    assert json.loads(first.read_text())["date"] == "2020-01-01", "the same results keep their date"
    monkeypatch.chdir(tmp_path)  # its docs/ is what a run without --out would write to
    whole_table_stays(alone, docs, capsys)
    more = [
        "fit-init.count=300",
        "filter.update.iterations=1",
        "identify.iterations=1",
        "identify.fit=table_friction",
        "train.made_up.episodes=1",
    ]
    assert main([*command, *options(more)]) == 0
    shown = capsys.readouterr().out
    assert shown.count("exists already") == 3 and "identify@" in shown
    store = Store(tmp_path / "work")
    assert "engine" in store.find("train@latest").manifest.inputs
    assert store.find("rollout@latest").manifest.inputs["model"]["stage"] == "train"
    both = {
        profile: json.loads((docs / "results" / f"disect{profile}.json").read_text())
        for profile in ("", "-cpu-recordings")
    }
    for profile, results in both.items():
        assert {"command", "versions", "seeds", "environments", "date", "commit", "machine"} <= results.keys()
        typed = f"plop reproduce <folder> --profile {profile.removeprefix('-') or 'cpu'} --env prism-jelly --set "
        assert results["command"].startswith(typed) and "'ingest.disect.episodes=*_part_00[04]'" in results["command"]
        assert set(results["environments"]["prism-jelly"]) == {"plop", "persistence", "rigid"}
        assert {"mean", "low", "high", "n"} <= results["environments"]["prism-jelly"]["plop"]["cd_mm"].keys()
        assert (docs / "results" / f"pictures{profile}" / "prism-jelly.png").stat().st_size > 0
    assert not list(docs.rglob("*.md")), "pages are made from the results elsewhere"
    assert main([*command[:2], "--env", "prism-jello", *command[4:]]) == 1
    assert "no such environment" in capsys.readouterr().err


def whole_table_stays(command: list[str], docs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run one environment once more beside a table of two, then without naming a folder for it."""
    path = docs / "results" / "disect-cpu-recordings.json"
    results = json.loads(path.read_text())
    path.write_text(json.dumps(results | {"environments": {**results["environments"], "sphere-foam": {}}}))
    before = {file: file.read_bytes() for file in docs.rglob("*") if file.is_file()}
    own = docs.parent / "work" / "results" / path.name
    for arguments in (command, [part for part in command if part not in ("--out", str(docs))]):
        own.unlink(missing_ok=True)
        assert main(arguments) == 0
        made = {"date", "commit", "machine"}
        assert {k: v for k, v in json.loads(own.read_text()).items() if k not in made} == {
            k: v for k, v in results.items() if k not in made
        }
        assert {file: file.read_bytes() for file in docs.rglob("*") if file.is_file()} == before
        assert ("sphere-foam, which this run lacks" in capsys.readouterr().err) == ("--out" in arguments)
    path.write_text(json.dumps(results))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["fuse.voxl_m=1"], ["fuse has no setting 'voxl_m'", "voxel_m"]),
        (["train.horizon=many"], ["train.horizon", "integer"]),
        (["ingest.droid.size=9"], ["a stage that does not run here", "ingest.droid"]),
    ],
)
def test_a_misspelt_setting_is_found_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], settings: list[str], words: list[str]
):
    raw, work = tmp_path / "raw", tmp_path / "work"
    raw.mkdir()
    (raw / "prism_jelly_000.npz").touch()
    for command in (["demo"], ["reproduce", str(raw)]):
        assert main([*command, "-w", str(work), *options(settings)]) == 1
        told = capsys.readouterr().err
        assert all(word in told for word in words)
        assert not work.exists()


@pytest.mark.parametrize("name", ["demo", "cpu", "cpu-recordings", "paper"])
def test_profiles_fit_the_stages(name: str):
    profile = read_profile(name)
    assert profile.seeds and profile.also == (("train.engine",) if name == "cpu" else ())
    for command, values in profile.settings.items():
        resolve(stage_ref(command).load().config, command, (name, values))


def test_a_profile_takes_over_what_it_is_based_on():
    base, alone = read_profile("cpu"), read_profile("cpu-recordings")
    assert alone.settings == base.settings and alone.seeds == base.seeds and base.also and not alone.also
    assert base.settings["identify"]["split"] == "train", "the engine learns from no test episode"
