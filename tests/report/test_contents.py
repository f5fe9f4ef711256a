"""What a report is about: which diagnoses it tells, and what it calls its models."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop.artifacts.manifest import Manifest
from plop.artifacts.store import Artifact
from stages.report.stage import ReportConfig, diagnoses_of, named_as_typed


def artifact(stage: str, fingerprint: str, **inputs: Artifact) -> Artifact:
    made_from = {name: {"stage": a.key[0], "fingerprint": a.key[1], "content": ""} for name, a in inputs.items()}
    return Artifact(Path(), Manifest(stage, fingerprint, 1, config={}, inputs=made_from))


def test_of_several_diagnoses_the_one_that_was_acted_on_counts_else_the_latest():
    def chosen(models: list[Artifact], found: list[Artifact]) -> list[Artifact]:
        return diagnoses_of(ReportConfig(), found, {"models": models})

    base = artifact("identify", "b")
    first, second, third = (artifact("diagnose", name, model=base) for name in ("d1", "d2", "d3"))
    assert chosen([base], [first, second, third]) == [third]
    more = artifact("augment", "m", model=base, diagnosis=second)
    again = artifact("diagnose", "d4", model=more)
    assert chosen([base, more], [first, second, third, again]) == [second, again]
    assert chosen([base], []) == []


@pytest.mark.parametrize(
    ("typed", "labels"),
    [("base, base+tilt", ("base", "base+tilt")), ("base", ("base",)), ("train@1234,base", ()), ("base,base", ())],
)
def test_models_are_called_as_the_user_typed_them(typed: str, labels: tuple[str, ...]):
    assert named_as_typed(ReportConfig(), {"models": typed}).labels == labels
    assert named_as_typed(ReportConfig(labels=("mine",)), {"models": typed}).labels == ("mine",)
