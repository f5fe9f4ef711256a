"""Two laws that hide each other are found together, in a made-up world without engine."""

from __future__ import annotations

import numpy as np
import pytest

from plop.diagnosis.candidates import Candidate, Column
from plop.diagnosis.diagnose import _two_are_tried
from plop.diagnosis.pairs import _turned
from plop.diagnosis.verdict import Verdict
from tests.support.world import World

LAWS = ("stiffness", "adhesion", "tilt", "swelling", "fibres")
HIDDEN = {"adhesion": 600.0, "gx_m_s2": 1.5, "gy_m_s2": -1.0}


class Sticking(World):
    """What adhesion has lifted moves otherwise under a tilt than what lies still."""

    def amounts(self, values: dict[str, float]) -> list[float]:
        lifted, x, y = values.get("adhesion", 0.0) / 300, values.get("gx_m_s2", 0.0), values.get("gy_m_s2", 0.0)
        free, held = min(lifted, 1.0), 1 - min(lifted, 1.0)
        return [
            values.get("stiffness", 0.0),
            0.5 * lifted / (1 + 0.2 * lifted),
            10 * values.get("swelling", 0.0),
            0.3 * values.get("fibres", 0.0),
            free * x,
            free * y,
            held * x,
            held * y,
        ]


def told(hidden: dict[str, float]):
    world = Sticking()
    return world.told(hidden, LAWS), world


def test_two_laws_that_hide_each_other_are_named_together():
    found, _ = told(HIDDEN)
    assert found.verdict.evidence["alone"]["kind"] in ("NONE OF THESE", "PARTLY")
    assert (found.verdict.kind, set(found.verdict.named)) == ("EFFECT", {"adhesion", "tilt"})
    fitted = {name: p for f in found.findings[:2] for name, p in f.parameters.items()}
    assert fitted["gx_m_s2"]["value"] == pytest.approx(1.5, rel=0.15)
    assert fitted["gy_m_s2"]["value"] == pytest.approx(-1.0, rel=0.15)
    assert fitted["traction_pa"]["value"] == pytest.approx(600, rel=0.15)
    assert [f.name for f in found.findings].count("tilt") == 1 and found.findings[-1].name == "stiffness"


def test_where_one_law_settles_it_no_pair_is_tried():
    found, world = told({"swelling": -0.1})
    assert (found.verdict.kind, found.verdict.named) == ("EFFECT", ["swelling"])
    _, more = told(HIDDEN)
    assert world.ran < 0.8 * more.ran


def test_a_law_of_two_amplitudes_is_tried_in_other_directions_as_large():
    tilt = Candidate(
        "tilt", "physics", tuple(Column("tilt", name, "m/s^2", (), 1.0, -5.0, 5.0) for name in ("gx_m_s2", "gy_m_s2"))
    )
    sticky = Candidate("adhesion", "physics", (Column("adhesion", "traction_pa", "Pa", (), 300.0, 0, 1e5),))
    for first, second, start in ((tilt, sticky, [-3.0, 4.0, 500.0]), (sticky, tilt, [500.0, -3.0, 4.0])):
        places = np.array(_turned(first, second, np.array(start)))
        own = slice(0, 2) if first is tilt else slice(1, 3)
        assert len(places) == 8 and len({tuple(place) for place in places.round(6)}) == 8
        np.testing.assert_allclose(np.linalg.norm(places[:, own], axis=1), 5.0)
        assert (np.delete(places, [own.start, own.start + 1], axis=1) == 500.0).all()
    assert not _turned(sticky, sticky, np.array([1.0, 2.0]))


@pytest.mark.parametrize(
    ("kind", "named", "tried"),
    [
        ("NONE OF THESE", [], True),
        ("PARTLY", ["tilt"], True),
        ("EFFECT", ["tilt", "adhesion"], True),
        ("EFFECT", ["tilt"], False),
        ("CONFOUNDED", ["tilt", "adhesion"], False),
        ("NOTHING DETECTABLE", [], False),
        ("BASE PARAMETER", ["stiffness"], False),
        ("SENSOR", ["clock", "scale"], False),
    ],
)
def test_two_are_fitted_together_where_one_does_not_settle_it(kind, named, tried):
    assert _two_are_tried(Verdict(kind, named, "")) == tried
