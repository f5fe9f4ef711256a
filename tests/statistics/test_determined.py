"""One rule for what recordings do not determine: bounds, open ends, wide intervals, settings that all do as well."""

import pytest

from plop.statistics.determined import Allowed, determined

FRICTION, STIFFNESS, TRACTION = Allowed(0, 2, 0.03), Allowed(1e2, 1e8, 0.05, logarithmic=True), Allowed(0, 1e5, 20)
TOUGHNESS, RELEASE = Allowed(-1000, 1000, 5), Allowed(0.001, 10, tried=3)


def interval(low, high, **more):
    return {"value": 1.0, "low": low, "high": high, "at_bound": False, **more}


@pytest.mark.parametrize(
    ("name", "found", "allowed", "known"),
    [
        ("table_friction", interval(0.35, 0.49), FRICTION, True),
        ("tool_friction", interval(0.0, 0.9), FRICTION, True),
        ("tool_friction", interval(0.0, 1.55), FRICTION, False),
        ("tool_friction", interval(0.35, 0.49, at_bound=True), FRICTION, False),
        ("youngs_modulus_pa", interval(1e4, 1.7e4), STIFFNESS, True),
        ("youngs_modulus_pa", interval(1e4, 1.5e5), STIFFNESS, False),
        ("youngs_modulus_pa", interval(float("-inf"), float("inf")), STIFFNESS, False),
        ("youngs_modulus_pa", interval(None, None), STIFFNESS, False),
        ("traction_pa", interval(184, 1500), TRACTION, True),
        ("traction_pa", interval(184, 7890), TRACTION, False),
        ("traction_pa", interval(0, 100), TRACTION, True),  # hardly there, which is a result
        ("traction_pa", interval(1e-6, 100), TRACTION, True),  # the same
        ("d_j_m2", interval(-400, -30), TOUGHNESS, False),
        ("d_j_m2", interval(-90, -30), TOUGHNESS, True),
        ("d_j_m2", interval(-20, 30), TOUGHNESS, True),
        ("d_ln_e", interval(-0.4, 0.5), Allowed(-3, 3, 0.05), True),
        ("d_ln_e", interval(-1.4, 1.5), Allowed(-3, 3, 0.05), False),
        ("own", interval(1, 2), None, True),
        ("own", interval(1, None), None, False),
        ("release_s", {"value": 0.1, "chosen": True, "also": [0.03, 0.3]}, RELEASE, False),
        ("release_s", {"value": 0.1, "chosen": True, "also": []}, RELEASE, True),
        ("angle_deg", {"value": 0, "chosen": True, "also": [45]}, Allowed(-180, 180, tried=4), True),
    ],
)
def test_what_is_determined(name, found, allowed, known):
    assert determined(name, found, allowed) == known
