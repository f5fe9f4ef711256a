"""What the annotation of a setting says is what its values are held against."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

import pytest

from plop.errors import PlopError
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.render.losses import RenderWeights
from plop.setting_kinds import COMMON, SAME_RESULT, Formerly, Range, Settings, Unit, kind_of, kinds_of
from stages.train.settings import TrainConfig

INF = math.inf


@dataclass(frozen=True)
class Inner(Settings):
    """A group."""

    share: Annotated[float, Range(0, 1)] = 0.5


@dataclass(frozen=True)
class Config(Settings):
    """Every kind of setting."""

    voxel_m: Annotated[float, Range(0, 0.1, above=True), Unit("m")] = 0.01
    steps: Annotated[int, Range(1), Unit("steps")] = 3
    jobs: Annotated[int, Range(but=0)] = -1
    dt_s: Annotated[float | None, Range(0), Unit("s")] = None
    corner: Annotated[tuple[float, float], Range(-1, 1), Unit("m")] = (0.0, 0.0)
    scales: tuple[float, ...] = ()
    form: Literal["paper", "solid"] = "paper"
    free: float = 0.0
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("key", "value", "problem", "expected"),
    [
        ("voxel_m", 0.0, "out of range", "more than 0 to 0.1 m"),
        ("voxel_m", 0.2, "out of range", "more than 0 to 0.1 m"),
        ("voxel_m", math.nan, "not finite", "more than 0 to 0.1 m"),
        ("voxel_m", "0.01", "invalid value", "number"),
        ("steps", 0, "out of range", "1 or more steps"),
        ("steps", 2.0, "invalid value", "integer"),
        ("steps", True, "invalid value", "integer"),
        ("jobs", 0, "out of range", "any number, not 0"),
        ("dt_s", -1.0, "out of range", "0 or more s"),
        ("corner", (0.0, 1.5), "out of range", "-1 to 1 m"),
        ("corner", (0.0,), "invalid value", "number, number"),
        ("corner", (0.0, math.inf), "not finite", "-1 to 1 m"),
        ("scales", (1.0, math.nan), "not finite", "a finite number"),
        ("form", "foam", "invalid value", "paper or solid"),
        ("free", -math.inf, "not finite", "a finite number"),
    ],
)
def test_no_object_breaks_its_annotations(key: str, value: Any, problem: str, expected: str):
    with pytest.raises(PlopError, match=problem) as caught:
        replace(Config(), **{key: value})
    assert (caught.value.where, caught.value.expected) == (f"Config.{key}", expected)
    assert caught.value.found in (str(value), repr(value)) and caught.value.fix


def test_what_is_in_range_is_taken():
    ends = Config(0.1, 1, 5, 0.0, (-1.0, 1.0), (1e9,), "solid", -1e300, Inner(1.0))
    assert replace(ends, dt_s=None).inner.share == 1.0


@pytest.mark.parametrize(
    ("bounds", "unit", "text"),
    [
        (Range(0, 1), "", "0 to 1"),
        (Range(1), "frames", "1 or more frames"),
        (Range(0, above=True), "m", "more than 0 m"),
        (Range(1e-6, 1e6), "m", "1e-6 to 1e6 m"),
        (Range(but=0), "", "any number, not 0"),
        (Range(0, but=1), "models", "0 or more models, not 1"),
        (Range(), "m", ""),
    ],
)
def test_a_range_is_written_with_its_unit(bounds: Range, unit: str, text: str):
    assert bounds.text(unit) == text


def test_an_annotation_within_another_keeps_what_both_say():
    jobs = Annotated[int, Range(but=0), SAME_RESULT]
    kind = kind_of(Annotated[jobs, COMMON, Formerly("processes")])
    assert (kind.type, kind.marks, kind.formerly) == (int, {COMMON, SAME_RESULT}, ("processes",))
    assert kind.range == Range(but=0) and kind_of(str).range == Range()


@pytest.mark.parametrize(
    ("settings", "key", "value"),
    [
        (EngineConfig, "courant", 1.5),
        (EngineConfig, "dt_s", 0.0),
        (EngineConfig, "gravity_m_s2", (0.0, 0.0)),
        (Material, "poisson", 0.5),
        (Material, "youngs_modulus_pa", 1.0),
        (RenderWeights, "ssim", -0.1),
        (TrainConfig, "folds", 1),
    ],
)
def test_settings_of_the_library_are_checked_alike(settings: type, key: str, value: Any):
    with pytest.raises(PlopError, match=f"{settings.__name__}.{key}"):
        settings(**{key: value})


def test_defaults_that_are_not_given_in_a_group_stay():
    assert [field.name for field in fields(Config) if kinds_of(Config)[field.name].type is Inner] == ["inner"]
    assert replace(TrainConfig(), render=RenderWeights(ssim=0.2)).render.l1 == RenderWeights().l1


def test_a_training_without_steps_is_refused():
    with pytest.raises(PlopError, match="nothing to train"):
        TrainConfig(track_steps=0, image_steps=0)
