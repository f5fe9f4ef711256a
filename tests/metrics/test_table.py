"""The table over environments: shape, seeds, Markdown."""

import pytest

from plop.artifacts.atomic_file import write_json
from plop.errors import PlopError
from plop.metrics.scores import PARTS, Scores
from plop.metrics.table import collect, gains_to_markdown, to_markdown

BOTH = ("plop", "persistence")


def write_scores(path, shift=0.0, lpips=None):
    def parts(cd):
        return {part: {"cd_mm": cd + add, "lpips": lpips} for part, add in (("episode", 0), ("end", 2), ("start", 0))}

    scores = Scores(
        environment="box",
        method="plop",
        seed=0,
        conventions={"cd_mm": "...", "lpips": "..."},
        unavailable={},
        notes=(),
        methods={method: {part: dict.fromkeys(("cd_mm", "lpips")) for part in PARTS} for method in BOTH},
        better_than_persistence_percent={},
        episodes={
            "a": {"plop": parts(1 + shift), "persistence": parts(4)},
            "b": {"plop": parts(2 + shift), "persistence": parts(4)},
        },
    )
    write_json(path, scores.to_json(), sort_keys=False)
    return path


def test_the_shape_is_that_of_the_results_file(tmp_path):
    found = collect(
        {"prism-jelly": write_scores(tmp_path / "s.json")}, command="plop ...", versions={"plop": "1"}, seeds=[0]
    )
    assert (found["command"], found["versions"], found["seeds"]) == ("plop ...", {"plop": "1"}, [0])
    entry = found["environments"]["prism-jelly"]["plop"]
    assert entry["cd_mm"] == {"mean": 1.5, "low": 1.0, "high": 2.0, "n": 2}
    assert entry["end"]["cd_mm"]["mean"] == 3.5
    assert entry["lpips"] is None
    assert found["mean"]["better_than_persistence_percent"]["episode"]["plop"]["cd_mm"] == pytest.approx(62.5)


def test_seeds_are_averaged_within_an_episode(tmp_path):
    paths = [write_scores(tmp_path / "0.json"), write_scores(tmp_path / "1.json", shift=1)]
    entry = collect({"e": paths})["environments"]["e"]["plop"]["cd_mm"]
    assert entry == {"mean": 2.0, "low": 1.5, "high": 2.5, "n": 2}


def test_only_the_chosen_episodes_count(tmp_path):
    path = write_scores(tmp_path / "s.json")
    found = collect({"e": path}, chosen=lambda name: name == "b")
    assert found["environments"]["e"]["plop"]["cd_mm"]["mean"] == 2.0
    assert found["mean"]["better_than_persistence_percent"]["episode"]["plop"]["cd_mm"] == pytest.approx(50)
    assert collect({"e": path}, chosen=lambda name: False)["environments"] == {}


def test_gains_by_hand(tmp_path):
    scores = {"e": write_scores(tmp_path / "s.json"), "f": write_scores(tmp_path / "t.json", shift=-1)}
    rows = gains_to_markdown(collect(scores)).splitlines()
    assert rows[0] == "| environment | CD, whole | EMD, whole | nodes, whole | CD, end | EMD, end | nodes, end |"
    # e: 1 - 1.5 / 4 and 1 - 3.5 / 6; f: 1 - 0.5 / 4 and 1 - 2.5 / 6
    assert rows[2:] == [
        "| e | 62 | - | - | 42 | - | - |",
        "| f | 88 | - | - | 58 | - | - |",
        "| **mean** | **75** | - | - | **50** | - | - |",
    ]


def test_markdown_by_hand(tmp_path):
    text = to_markdown(collect({"e": write_scores(tmp_path / "s.json")}))
    assert text.splitlines() == [
        "| environment | method | n | CD [mm] |",
        "|---|---|---|---|",
        "| e | plop | 2 | 1.50 [1.00, 2.00] |",
        "| e | persistence | 2 | 4.00 [4.00, 4.00] |",
    ]
    assert "6.00" in to_markdown(collect({"e": write_scores(tmp_path / "s.json")}), part="end")


def test_what_is_undefined_in_one_environment_is_a_dash(tmp_path):
    results = collect({"e": write_scores(tmp_path / "s.json"), "f": write_scores(tmp_path / "t.json", lpips=0.5)})
    rows = to_markdown(results).splitlines()
    assert rows[2].endswith("| - |")
    assert rows[4].endswith("| 0.500 [0.500, 0.500] |")


@pytest.mark.parametrize("content", [None, "{", "[]", '{"methods": {}}', '{"schema": 1, "methods": {}}'])
def test_files_that_are_not_scores_are_named(tmp_path, content):
    path = tmp_path / "s.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(PlopError, match="cannot be read|another version") as caught:
        collect({"e": path})
    assert "s.json" in caught.value.where
