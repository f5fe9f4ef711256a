"""The table of docs/results.md that sets networks and engines side by side."""

from __future__ import annotations

from types import SimpleNamespace

from benchmarks.made_up import METRICS, Engines, table


def scores(value: float) -> dict:
    return {"plop": {**{key: {"mean": value} for key in METRICS}, "end": {key: {"mean": 3 * value} for key in METRICS}}}


def test_every_environment_has_three_lines_and_the_mean_stands_below():
    both = {"a": scores(1.0), "b": scores(2.0)}
    lines = table({**both, "c": scores(9.0)}, both, {"a": scores(0.5), "b": scores(1.0)}).splitlines()
    assert len(lines) == 2 + 3 * 3 and not any("| c |" in line for line in lines), "only what all three have"
    assert lines[2] == "| a | without | 1.00, 3.00 | 1.00, 3.00 | 1.00, 3.00 | 1.0, 3.0 | 1.000, 3.000 |"
    assert lines[-1].startswith("| **mean** | the engine itself | 0.75, 2.25 |")


def test_one_environment_has_no_mean():
    one = {"a": scores(1.0)}
    assert len(table(one, one, one).splitlines()) == 2 + 3


def test_an_engine_is_rolled_out_with_what_its_own_environment_has(tmp_path, monkeypatch):
    def artifact(stage: str, environment: str) -> SimpleNamespace:
        address = f"{stage}@{environment}"
        return SimpleNamespace(
            path=tmp_path / address, manifest=SimpleNamespace(environment=environment, address=address)
        )

    typed: list[tuple[str, ...]] = []
    monkeypatch.setattr(Engines, "plop", lambda self, *words: typed.append(words))
    engines = Engines(tmp_path)
    engines.store = SimpleNamespace(
        artifacts=lambda stage: [artifact(stage, name) for name in ("other", "a", "late")],
        find=lambda name: SimpleNamespace(path=tmp_path / name),
    )
    assert engines.scored("a") == tmp_path / "a-engine-scores" / "scores.json"
    assert [words[0] for words in typed] == ["rollout", "eval"]
    assert {"identify@a", "calibrate@a", "fit-init@a"} <= set(typed[0])
    assert typed[1][typed[1].index("--rollouts") + 1] == "a-engine"
