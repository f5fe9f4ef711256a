"""What the missing-physics benchmarks hide, in the order in which they run: a stop leaves all sets represented."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from benchmarks.missing_physics.row import Group
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library

DECOYS = {"drag": {"per_m": 200.0}, "inertia": {"ratio": 0.7}}
SNRS = (2.0, 4.0)
"""Displacement by the hidden effect over the noise that runs are made for."""
TURNED = {
    "swelling": ({"rate_per_s": 0.08}, {"rate_per_s": -0.1}),
    "viscosity": ({"viscosity_pa_s": 60.0}, {"viscosity_pa_s": 120.0}),
    "table_friction": ({"d_mu": -0.3}, {"d_mu": 0.6}),
    "plasticity": ({"softness_per_kpa": 1.5}, {"softness_per_kpa": 3.0}),
    "tilt": ({"gx_m_s2": 0.8, "gy_m_s2": -0.8}, {"gx_m_s2": -0.5, "gy_m_s2": -2.0}),
    "relaxation": ({"ratio": 0.6, "tau_s": 0.1}, {"ratio": 0.8, "tau_s": 0.03}),
    "fibres": ({"ratio": 4.0, "angle_deg": 30.0}, {"ratio": 10.0, "angle_deg": 100.0}),
    "softening": ({"loss": 0.8, "strain": 0.02}, {"loss": 0.9, "strain": 0.01}),
    "stiffening": ({"growth": 200.0}, {"growth": 800.0}),
    "adhesion": ({"traction_pa": 250.0, "release_s": 0.1}, {"traction_pa": 600.0, "release_s": 0.05}),
    "toughness": ({"d_j_m2": 80.0}, {"d_j_m2": 150.0}),
    "blade_friction": ({"d_mu": 2.0}, {"d_mu": 2.0}),
}
"""Effect -> direction and shape for each of SNRS; the amplitude there is where the search for the signal starts."""
POINTS_PAIRS = (
    ("stiffening", "swelling"),
    ("adhesion", "tilt"),
    ("relaxation", "tilt"),
    ("plasticity", "swelling"),
    ("softening", "table_friction"),
    ("fibres", "swelling"),
)
POINTS_OUTSIDE = ("relaxation", "adhesion", "stiffening", "fibres", "tilt", "swelling")
FRESH_OUTSIDE = ("plasticity", "table_friction", "toughness", "fibres", "tilt", "relaxation")
BASE = {"stiffness": {"d_ln_e": -0.5}, "damping": {"d_per_s": 60.0}}
CAMERA_PAIRS = (("adhesion", "tilt"), ("swelling", "table_friction"), ("plasticity", "swelling"))
CAMERA_OUTSIDE = ("plasticity", "table_friction", "tilt", "adhesion")
FAULTS = ("clock=0.02", "depth_scale=1.01", "pose_error.x_m=0.004")
CAMERA_NULLS = 6
ROUGH = ("snr4-swelling", "null-0", "snr4-table_friction", "snr4-plasticity", "snr4-tilt", "null-1")
"""Runs through cameras that are made again with bad ones."""
Values = Mapping[str, float]


@dataclass(frozen=True)
class Run:
    """One line of a plan."""

    name: str
    group: Group
    seed: int
    hidden: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """Effects, with their parameters."""
    snr: float | None = None
    """Signal that each hidden effect is scaled to; None: amplitudes as they are written here."""
    without: str = ""
    """Effect taken out of the library of the diagnosis."""
    fault: str = ""
    """Fault of the cameras or of the tool's pose, as typed after --fault."""

    def effects(self) -> list[Effect]:
        """Build what is hidden."""
        types = library()
        return [types[name](**dict(values)) for name, values in self.hidden]

    def typed(self) -> list[str]:
        """Give what is hidden as typed after --hide, within the ranges of the effects."""
        types = library()
        ends = {name: {p.name: (p.low, p.high) for p in types[name].parameters()} for name, _ in self.hidden}
        return [
            f"{name}.{key}={min(max(value, ends[name][key][0]), ends[name][key][1]):g}"
            for name, values in self.hidden
            for key, value in values
        ]


def _hiding(effects: Iterable[tuple[str, Values]]) -> tuple[tuple[str, tuple[tuple[str, float], ...]], ...]:
    return tuple((name, tuple(values.items())) for name, values in effects)


def _run(name: str, group: Group, seed: int, *effects: tuple[str, Values], **more: object) -> Run:
    return Run(name, group, seed, _hiding(effects), **more)  # type: ignore[arg-type]


def _mixed(queues: list[list[Run]], shares: list[int]) -> list[Run]:
    """Take from all queues in turn, so that a stop leaves all of them represented."""
    mixed: list[Run] = []
    while any(queues):
        for queue, share in zip(queues, shares, strict=True):
            mixed += [queue.pop(0) for _ in range(min(share, len(queue)))]
    return mixed


def _nulls(stem: str, seed: int, count: int) -> list[Run]:
    return [Run(f"{stem}-{k}", Group.NULL, seed + k) for k in range(count)]


def _at_signals() -> list[Run]:
    singles = [
        _run(f"snr{SNRS[k]:g}-{name}", Group.SINGLE, 2000 + 100 * k + n, (name, values[k]), snr=SNRS[k])
        for k in (1, 0)
        for n, (name, values) in enumerate(TURNED.items())
    ]
    base = [
        _run(f"base-more-{name}", Group.BASE, 2500 + k, (name, values), snr=2.0)
        for k, (name, values) in enumerate(BASE.items())
    ]
    pairs = [
        _run(f"pair-more-{a}-{b}", Group.PAIR, 2600 + k, (a, TURNED[a][0]), (b, TURNED[b][0]), snr=2.5)
        for k, (a, b) in enumerate(POINTS_PAIRS)
    ]
    outside = [
        _run(f"outside-more-{name}", Group.OUTSIDE, 2700 + k, (name, TURNED[name][1]), without=name, snr=3.0)
        for k, name in enumerate(POINTS_OUTSIDE)
    ]
    return _mixed([singles, _nulls("null-more", 2400, 12), base, pairs, outside], [4, 2, 1, 1, 1])


def _fresh() -> list[Run]:
    """Runs that were first made after the diagnosis and the finer engine were fixed."""
    return [
        _run(f"outside-fresh-{name}", Group.OUTSIDE, 2800 + k, (name, TURNED[name][0]), without=name, snr=3.0)
        for k, name in enumerate(FRESH_OUTSIDE)
    ]


def points_plan() -> list[Run]:
    """List the runs on followed points."""
    return [*_at_signals(), *_fresh()]


def cameras_plan() -> list[Run]:
    """List the runs through cameras."""
    strong, weak = (
        [
            _run(f"snr{snr:g}-{name}", Group.SINGLE, seed + k, (name, values[level]), snr=snr)
            for k, (name, values) in enumerate(TURNED.items())
        ]
        for level, snr, seed in ((1, 4.0, 3000), (0, 2.0, 3100))
    )
    others = _nulls("null", 3200, CAMERA_NULLS)
    others += [
        _run(f"pair-{a}-{b}", Group.PAIR, 3300 + k, (a, TURNED[a][1]), (b, TURNED[b][1]), snr=4.0)
        for k, (a, b) in enumerate(CAMERA_PAIRS)
    ]
    others += [
        _run(f"outside-{name}", Group.OUTSIDE, 3400 + k, (name, TURNED[name][1]), snr=4.0, without=name)
        for k, name in enumerate(CAMERA_OUTSIDE)
    ]
    others += [
        _run(f"sensor-{fault.partition('=')[0].partition('.')[0]}", Group.SENSOR, 3500 + k, fault=fault)
        for k, fault in enumerate(FAULTS)
    ]
    others += [
        _run(f"base-{name}", Group.BASE, 3600 + k, (name, values), snr=2.0)
        for k, (name, values) in enumerate(BASE.items())
    ]
    others += [
        _run(f"decoy-{name}", Group.DECOY, 3700 + k, (name, values)) for k, (name, values) in enumerate(DECOYS.items())
    ]
    turn = sorted(range(len(others)), key=lambda k: (sum(o.group is others[k].group for o in others[:k]), k))
    first = [run for pair in zip(strong, [others[k] for k in turn], strict=False) for run in pair]
    return [*first, *(others[k] for k in turn[len(strong) :]), *weak]


def rough_plan() -> list[Run]:
    """List the runs through bad cameras: some of those through good ones, with seeds of their own.

    Laws move the object as far as there, which is once the noise of these cameras' depth.
    """
    runs = {run.name: run for run in cameras_plan()}
    return [
        replace(
            runs[name],
            name=name.replace("snr4", "rough").replace("null", "rough-null"),
            seed=runs[name].seed + 1000,
            snr=1.0 if runs[name].hidden else None,
        )
        for name in ROUGH
    ]


DEVELOPED = frozenset(
    {
        "snr4-relaxation",
        "snr2-softening",
        "pair-more-relaxation-tilt",
        "base-more-damping",
        "null-more-2",
        "pair-more-adhesion-tilt",
        "null-more-4",
        "null-more-5",
        "null-more-6",
        "null-more-7",
    }
)
"""Runs on followed points for whose sake rules of the verdict were changed: laws at the end of their range, base
parameters, laws that one episode alone shows, and the mean over discretisations (the last four)."""
