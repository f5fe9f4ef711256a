"""Which diagnosis tells the amplitude of an added effect."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from plop.pipeline.augment_inputs import augment_inputs
from plop.pipeline.preparation import Preparation

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from stages.augment.stage import AugmentConfig
from tests.pipeline.test_prepare import made, preparation, recordings


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def diagnosis(store: Store, model: Artifact, of: Artifact, fitted: list[str], seed: int = 0) -> Artifact:
    artifact = made(store, "diagnose", seed, recordings=of, model=model)
    facts = {"ranking": [{"effect": name} for name in fitted]}
    (artifact.path / "diagnosis.json").write_text(json.dumps(facts))
    return artifact


def chosen(store: Store, given: dict[str, str], config: AugmentConfig, **more: bool) -> str | None:
    found = augment_inputs(replace(preparation(store), **more), given, config, None).get("diagnosis")
    return None if found is None else str(found)


def test_the_latest_of_the_model_and_of_the_recordings_that_has_fitted_the_effect(store):
    plain, mystery, other = (recordings(store, "blocks", pieces=n) for n in (4, 5, 6))
    base, rival = made(store, "identify", recordings=plain), made(store, "train", recordings=plain, init=plain)
    wide = diagnosis(store, base, mystery, ["viscosity", "tilt"])
    narrow = diagnosis(store, base, mystery, ["tilt"], seed=1)
    elsewhere = diagnosis(store, base, other, ["viscosity"])
    diagnosis(store, rival, mystery, ["viscosity"])
    model = {"model": base.address}
    viscosity = AugmentConfig(effect="viscosity")
    assert chosen(store, model | {"fit": mystery.address}, viscosity) == wide.address
    assert chosen(store, model | {"fit": mystery.address}, AugmentConfig()) == narrow.address
    assert chosen(store, model, viscosity) == elsewhere.address


def test_given_values_and_taking_an_effect_out_need_no_diagnosis(store):
    plain, mystery = recordings(store, "blocks"), recordings(store, "blocks", pieces=5)
    base = made(store, "identify", recordings=plain)
    diagnosis(store, base, mystery, ["viscosity"])
    for config in (AugmentConfig(effect="viscosity", value=("viscosity_pa_s=1",)), AugmentConfig(remove=True)):
        assert chosen(store, {"model": base.address}, config) is None


def test_what_has_not_been_fitted_is_diagnosed_first(store, monkeypatch):
    plain, mystery, other = (recordings(store, "blocks", pieces=n) for n in (4, 5, 6))
    base = made(store, "identify", recordings=plain)
    diagnosis(store, base, mystery, ["tilt"])
    asked = []

    def diagnosed(self, model, of, effect, files):
        asked.append((model.key, of.key, effect, dict(files)))
        return diagnosis(store, model, of, [effect], seed=1)

    monkeypatch.setattr(Preparation, "diagnosed", diagnosed)
    given = {"model": base.address, "fit": mystery.address, "effect_file": "mine.py"}
    config = AugmentConfig(effect="viscosity")
    assert chosen(store, given, config, may_run=False) is None and not asked
    made_now = chosen(store, given, config)
    assert asked == [(base.key, mystery.key, "viscosity", {"effect_file": "mine.py"})]
    noting = replace(preparation(store), may_run=False)
    augment_inputs(noting, {"model": base.address, "fit": other.address}, config, None)
    assert noting.would_run == {"diagnosis": "diagnose"}
    assert made_now != store.artifacts("diagnose")[0].address
    assert chosen(store, given, config) == made_now and len(asked) == 1


def test_a_diagnosis_and_recordings_at_once_are_refused(store):
    with pytest.raises(PlopError, match="Both --fit and --diagnosis"):
        chosen(store, {"fit": "mystery", "diagnosis": "verdict"}, AugmentConfig())
