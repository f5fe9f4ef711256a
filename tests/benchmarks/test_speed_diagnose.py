"""The benchmark of how long `diagnose` takes: its libraries."""

from __future__ import annotations

from benchmarks.speed.diagnose import HIDDEN, libraries
from plop.physics.effects.library import library


def test_twelve_laws_act_on_the_object_and_the_hidden_one_can_be_left_out():
    twelve, whole, without = libraries().values()
    assert len(twelve) == 12 and HIDDEN in twelve and not {"drag", "stiffness"} & set(twelve)
    assert whole == list(library()) and set(whole) - set(without) == {HIDDEN}
