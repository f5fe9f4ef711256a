"""What a report calls its models, and which of several diagnoses it tells."""

from __future__ import annotations

from pathlib import Path

import pytest
from plop.pipeline.report_inputs import diagnoses_of, labels_of_models

from plop.artifacts.manifest import Manifest
from plop.artifacts.store import Artifact


@pytest.mark.parametrize(
    ("typed", "labels"),
    [("base, base+tilt", ("base", "base+tilt")), ("base", ("base",)), ("train@1234,base", ()), ("base,base", ())],
)
def test_models_are_called_as_the_user_typed_them(typed: str, labels: tuple[str, ...]):
    assert labels_of_models(typed) == labels


def artifact(stage: str, fingerprint: str, **inputs: Artifact) -> Artifact:
    made_from = {name: {"stage": a.key[0], "fingerprint": a.key[1], "content": ""} for name, a in inputs.items()}
    return Artifact(Path(), Manifest(stage, fingerprint, 1, config={}, inputs=made_from))


def test_of_several_diagnoses_the_one_that_was_acted_on_counts_else_the_latest():
    base = artifact("identify", "b")
    first, second, third = (artifact("diagnose", name, model=base) for name in ("d1", "d2", "d3"))
    assert diagnoses_of([base], [first, second, third]) == [third]
    more = artifact("augment", "m", model=base, diagnosis=second)
    again = artifact("diagnose", "d4", model=more)
    assert diagnoses_of([base, more], [first, second, third, again]) == [second, again]
    assert diagnoses_of([base], []) == []
