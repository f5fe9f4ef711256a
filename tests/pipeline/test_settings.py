"""Settings come from defaults, plop.toml and the command line, and mistakes are named."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pytest

from plop.errors import PlopError
from plop.pipeline.setting_values import convert
from plop.pipeline.settings import checked, resolve, settings_of
from plop.pipeline.settings_file import own_assignments, parse_assignments, read_settings_file
from plop.setting_kinds import Seed, Settings, describe

COMMANDS = ["ingest disect", "ingest mesh", "fit-init", "train"]


class Form(enum.Enum):
    PAPER = "paper"
    SOLID = "solid"


@dataclass(frozen=True)
class Grid(Settings):
    """Inner settings."""

    cells: int = 32
    """Cells along a side."""


@dataclass(frozen=True)
class Config(Settings):
    """Settings of a stage."""

    voxel_m: float = 0.003
    """Edge of one voxel [m]."""
    steps: int = 10
    test: tuple[str, ...] = ()
    """Globs."""
    form: Literal["paper", "solid"] = "paper"
    limit: int | None = None
    resample: bool = True
    low: tuple[float, ...] = ()
    seed: Seed = 0
    grid: Grid = field(default_factory=Grid)
    """Of the grid."""


def test_every_field_is_listed_with_its_docstring():
    found = {setting.key: setting for setting in settings_of(Config)}
    assert list(found) == ["voxel_m", "steps", "test", "form", "limit", "resample", "low", "seed", "grid.cells"]
    assert found["voxel_m"].help == "Edge of one voxel [m]."
    assert found["steps"].help == ""
    inner = found["grid.cells"]
    assert (inner.default, inner.help, inner.group) == (32, "Cells along a side.", "Of the grid.")


def test_later_layers_win_and_nested_fields_are_reached():
    config = resolve(Config, "fuse", ("file", {"steps": 5, "grid.cells": 8}), ("line", {"steps": "7"}))
    assert config == Config(steps=7, grid=Grid(8))


def test_unknown_key_suggests_the_right_one():
    with pytest.raises(PlopError) as caught:
        resolve(Config, "fuse", ("plop.toml", {"voxl_m": 1}))
    assert "voxel_m" in str(caught.value.fix)
    assert caught.value.where == "plop.toml"


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("3", int, 3),
        ("1e3", int, 1000),
        ("3", float, 3.0),
        ("1e-3", float, 0.001),
        ("off", bool, False),
        ("a, b", tuple[str, ...], ("a", "b")),
        ("1,2", tuple[int, int], (1, 2)),
        ([1, 2], tuple[float, ...], (1.0, 2.0)),
        ("none", int | None, None),
        ("4", int | None, 4),
        ("solid", Literal["paper", "solid"], "solid"),
        ("solid", Form, Form.SOLID),
        ("2", Literal[1, 2], 2),
        ("x", str, "x"),
    ],
)
def test_values_are_converted(text: Any, kind: Any, value: Any):
    assert convert(text, kind) == value


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("3.5", int),
        ("x", float),
        (True, int),
        ("maybe", bool),
        ("cubic", Literal["paper", "solid"]),
        ("1,2,3", tuple[int, int]),
        (3, str),
        ("x", Form),
    ],
)
def test_wrong_values_are_clear_errors(text: Any, kind: Any):
    with pytest.raises(ValueError, match=str(text)):
        convert(text, kind)
    with pytest.raises(PlopError, match="invalid value") as caught:
        checked(text, kind, where="plop.toml: fuse.k", fix="so")
    assert (caught.value.where, caught.value.expected) == ("plop.toml: fuse.k", describe(kind))


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("voxel_m", "nan", "not finite"),
        ("voxel_m", float("inf"), "not finite"),
        ("low", "0,-inf", "not finite"),
        ("steps", "inf", "invalid value"),
        ("limit", "1e999", "invalid value"),
        ("seed", "-1", "out of range"),
    ],
)
def test_what_no_setting_takes_is_refused_by_name(key: str, value: Any, problem: str):
    with pytest.raises(PlopError, match=problem) as caught:
        resolve(Config, "fuse", ("--set", {key: value}))
    assert (caught.value.where, caught.value.expected is None) == (f"--set: fuse.{key}", False)


def test_a_choice_that_is_mistyped_gets_a_suggestion():
    with pytest.raises(PlopError) as caught:
        resolve(Config, "fuse", ("--set", {"form": "solit"}))
    assert caught.value.fix == "Did you mean solid?" and caught.value.expected == "paper or solid"


def test_nested_tables_of_a_settings_file_are_groups(tmp_path: Path):
    path = tmp_path / "plop.toml"
    path.write_text("[train]\nsteps = 5\n[train.grid]\ncells = 8\n")
    layer = read_settings_file(path, COMMANDS)["train"]
    assert resolve(Config, "train", ("plop.toml", layer)) == Config(steps=5, grid=Grid(8))
    with pytest.raises(PlopError) as caught:
        resolve(Config, "train", ("plop.toml", {"grid.cels": 8}))
    assert caught.value.fix == "Did you mean grid.cells?"


def test_same_setting_spelled_differently_is_the_same():
    assert resolve(Config, "fuse", ("a", {"voxel_m": "3e-3"})) == resolve(Config, "fuse", ("b", {"voxel_m": 0.003}))


def test_types_are_described():
    assert describe(tuple[int, int]) == "integer, integer"
    assert describe(int | None) == "integer or none"
    assert describe(Literal["a", "b"]) == "a or b"


def test_settings_file_by_command(tmp_path: Path):
    path = tmp_path / "plop.toml"
    path.write_text("[train]\nhorizon = 8\ngrid.cells = 4\n[ingest.disect]\nsize = 64\n")
    assert read_settings_file(path, COMMANDS) == {
        "train": {"horizon": 8, "grid.cells": 4},
        "ingest disect": {"size": 64},
    }
    assert read_settings_file(tmp_path / "absent.toml", COMMANDS) == {}


@pytest.mark.parametrize(
    ("text", "word"),
    [("[trian]\nx = 1", "train"), ("x = 1", "plop.toml"), ("[train", "TOML"), ("train = 3", "[train]")],
)
def test_bad_settings_file_is_a_clear_error(tmp_path: Path, text: str, word: str):
    path = tmp_path / "plop.toml"
    path.write_text(text)
    with pytest.raises(PlopError) as caught:
        read_settings_file(path, COMMANDS)
    assert word in caught.value.render()


def test_assignments():
    assert own_assignments(["horizon=8", "train.seed=1", "fill-at=2"], "train", COMMANDS) == {
        "horizon": "8",
        "seed": "1",
        "fill_at": "2",
    }
    assert parse_assignments(["ingest.mesh.size=9", "fit-init.steps=1"], COMMANDS) == {
        "ingest mesh": {"size": "9"},
        "fit-init": {"steps": "1"},
    }
    with pytest.raises(PlopError, match="no effect"):
        own_assignments(["train.horizon=8"], "fit-init", COMMANDS)
    with pytest.raises(PlopError, match="key=value"):
        own_assignments(["horizon"], "train", COMMANDS)
    with pytest.raises(PlopError, match="needs the name of the stage"):
        parse_assignments(["horizon=8"], COMMANDS)


def test_a_list_may_be_written_as_toml_writes_it():
    words = ['["*_004", "*_005"]', "*_004,*_005", '[ "*_004","*_005" ]']
    assert {convert(text, tuple[str, ...]) for text in words} == {("*_004", "*_005")}
    assert convert("[ab]*, c", tuple[str, ...]) == ("[ab]*", "c")
    assert convert("[1, 2.5]", tuple[float, ...]) == (1.0, 2.5)
