"""The graph that the stages declare: no circle, every maker known, chains in an order that works."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

import pytest

from plop.pipeline.chain import chain, layers_of, read_profile
from plop.pipeline.graph import Graph
from plop.pipeline.registry import StageRef, pipeline, stage_ref
from plop.pipeline.stage import Choice, InputSpec, Origin, Recipe, Stage
from plop.pipeline.tasks import in_order
from plop.pipeline.upstream import Planner
from tests.pipeline import fake_stages as fake
from tests.pipeline.made_up import ref_to

COMMANDS = [ref.command for ref in pipeline()]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_declaration_names_stages_and_inputs_that_there_are(command: str):
    stages = {ref.name for ref in pipeline()}
    inputs = stage_ref(command).load().inputs
    for name, spec in inputs.items():
        assert set(spec.stages) <= stages, name
        origin = [spec.choice] if isinstance(spec.choice, Origin) else []
        if spec.recipe is not None:
            theirs = stage_ref(spec.stages[0]).load().inputs
            assert spec.recipe.inputs.keys() <= theirs.keys(), name
            required = {key for key, one in theirs.items() if not (one.optional or one.recipe) and one.read}
            assert required <= spec.recipe.inputs.keys(), f"{name}: {required - spec.recipe.inputs.keys()} is not bound"
            for own in spec.recipe.inputs.values():
                origin += [own] if isinstance(own, Origin) else []
                assert isinstance(own, Origin) or own in inputs, name
        for one in origin:
            assert one.model in inputs and (not one.apart_from or one.apart_from in inputs)
        if spec.choice in (Choice.MADE, Choice.MATCHING):
            assert spec.recipe is not None, name
        assert spec.read or spec.choice in (Choice.NAMED, Choice.ANY_LINE), name


def test_the_runner_names_no_stage():
    """The declarations are the only place that knows which stage follows on which."""
    names = {name for ref in pipeline() for name in (ref.name, ref.command)}
    for path in (Path(__file__).resolve().parents[2] / "plop" / "pipeline").glob("*.py"):
        words = {node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)}
        assert not words & names or path.name in ("diagnose.py", "settings_file.py"), path


@pytest.mark.parametrize(
    ("target", "begin", "also", "expected"),
    [
        ("eval", "ingest mesh", (), "ingest mesh,calibrate,fuse,fit-init,train,rollout,eval"),
        (
            "eval",
            "ingest disect",
            ("train.engine",),
            "ingest disect,calibrate,fuse,fit-init,filter,identify,train,rollout,eval",
        ),
        ("identify", "simulate", (), "simulate,calibrate,fuse,fit-init,filter,identify"),
        ("calibrate", "ingest droid", (), "ingest droid,calibrate"),
    ],
)
def test_a_chain_is_read_from_the_declarations(target, begin, also, expected):
    found = Graph().chain(target, begin=begin, also=also)
    assert ",".join(found) == expected
    for before, after in pairwise(found):
        assert before not in found[before].values() and after != before
    for command, sources in found.items():
        assert all(list(found).index(source) < list(found).index(command) for source in sources.values())


def test_a_circle_of_declarations_is_told():
    one = Stage("one", 1, "", fake.JoinConfig, {"a": InputSpec(("two",), "")}, fake.join_pieces)
    two = Stage("two", 1, "", fake.JoinConfig, {"a": InputSpec(("one",), "")}, fake.join_pieces)
    with pytest.raises(ValueError, match="cycle: one -> two -> one"):
        Graph([ref_to(one), ref_to(two), StageRef("raw", "", "")]).chain("one", begin="raw")


def test_two_seeds_share_what_comes_before(tmp_path):
    from plop.artifacts.store import Store

    raw = fake.raw_folder(tmp_path / "raw")
    store = Store(tmp_path)
    graph = Graph([StageRef(name, f"tests.pipeline.fake_stages:{name.upper()}", "") for name in ("ingest", "fuse")])
    planner = Planner(store, graph=graph)
    layers = layers_of(store, read_profile("demo"), [])
    assert planner.graph.maker(InputSpec(("fuse",), "", recipe=Recipe({}))).command == "fuse"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("plop.pipeline.chain.stage_ref", lambda command: {r.command: r for r in graph.refs}[command])
        several = [
            chain(planner, layers, target="fuse", begin="ingest", raw=raw, extra={"fuse": {"upper": upper}})
            for upper in (False, True, False)
        ]
    assert [len({id(tasks[name]) for tasks in several}) for name in ("ingest", "fuse")] == [1, 2]
    assert len(in_order(tasks["fuse"] for tasks in several)) == 3
