"""Which motions part the laws that hold a cut back: toughness, adhesion, cohesion.

`python -m studies.cohesive_motions` simulates the shipped block in every motion with a cut, with each law at the
same signal, and writes docs/results/cohesive_motions.json and prints the tables of docs/effects.md. Seeds draw where, how fast
and at which angle it is cut; all motions of a seed make the same cut.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.solver import simulate
from plop.physics.scenes import find_scene
from plop.physics.scenes.motions import CUTS, MotionPlan, draw_motion, tool_motion
from plop.physics.scenes.scene import Scene, settled
from plop.physics.scenes.shapes import halved_body

HERE = Path(__file__).resolve().parent
RESULT = HERE.parent / "docs" / "results" / "cohesive_motions.json"
COMMAND = "python -m studies.cohesive_motions"
SEEDS = (0, 1, 2)
SPACING_M = 0.005
SIGNAL_MM = 0.2
"""RMS over surface points, frames and motions of the first seed to which every law is scaled."""
SCALED_IN = tuple(kind for kind in CUTS if kind != "cut-push")
"""A push is left out: there, what holds together moves the whole other half, or does not."""
TRIALS, CLOSE = 4, 1.1
LAWS: dict[str, tuple[str, dict[str, float], str]] = {
    "toughness": ("toughness", {}, "d_j_m2"),
    "adhesion": ("adhesion", {"release_s": 0.1}, "traction_pa"),
    "cohesion": ("cohesion", {"opening_m": 0.004}, "traction_pa"),
    "cohesion, 1 mm": ("cohesion", {"opening_m": 0.001}, "traction_pa"),
}
"""Row -> effect, setting, amplitude that is scaled."""
OBSERVED = {
    "force_n": "force while cutting [N]",
    "lift_mm": "lift when drawn out [mm]",
    "gap_mm": "gap afterwards [mm]",
}
Figures = dict[str, Any]


@dataclass(frozen=True)
class Seen:
    """What one run shows."""

    points: np.ndarray
    """Surface points, [T, V, 3] [m]."""
    force_n: float
    """Mean force down on the object while the edge goes through it."""
    lift_mm: float
    """Highest mean rise of the surface points while the blade is drawn out; NaN where it is not."""
    gap_mm: float
    """Mean distance between points that coincided on the faces of the cut, at the end."""


def scene() -> Scene:
    """Take the shipped block, on a coarser grid."""
    return replace(Scene.read(find_scene(Path("block"))), spacing_m=SPACING_M, dx_m=2 * SPACING_M)


def plan_of(kind: str, seed: int) -> MotionPlan:
    """Draw a motion; the same cut for every kind."""
    return draw_motion(kind, scene().motion, np.random.default_rng([seed, 7]))


@cache
def _ready(seed: int) -> tuple[Any, Any]:
    plan, given = plan_of("cut", seed), scene()
    body = halved_body(given.shape, SPACING_M, plan.x_m, plan.yaw_rad)
    return body, settled(body.particles, given.material, EngineConfig(dx_m=given.dx_m), [])


def see(kind: str, seed: int, *effects: Effect) -> Seen:
    """Simulate one motion. None of these laws acts before the blade comes, so that all begin from the same rest."""
    given, plan = scene(), plan_of(kind, seed)
    body, start = _ready(seed)
    motion = tool_motion(plan, given.shape, given.frame_rate_hz)
    run = simulate(start, given.material, motion, motion.times, EngineConfig(dx_m=given.dx_m), effects=effects)
    edge = motion.world_from_tool[:, 2, 3]
    turn = int(edge.argmin())
    inside = (edge < given.shape.height_m) & (edge > 0)
    cutting, drawing = inside & (np.arange(len(edge)) <= turn), inside & (np.arange(len(edge)) > turn)
    points = run.positions[:, body.surface].astype(np.float64)
    lift = (points[drawing, :, 2].mean(1) - points[turn, :, 2].mean()).max() if drawing.any() else np.nan
    first, second = _faces(body)
    gap = np.linalg.norm(run.positions[-1, first] - run.positions[-1, second], axis=1).mean()
    return Seen(points, float(-run.tool_force[cutting, 2].mean()), 1e3 * float(lift), 1e3 * float(gap))


def _faces(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Particles on both faces of the cut that coincide at rest."""
    places, sides = body.particles.positions, body.particles.sides
    one, other = np.flatnonzero(sides > 0), np.flatnonzero(sides < 0)
    away, nearest = cKDTree(places[other]).query(places[one])
    return one[away < 1e-6], other[nearest[away < 1e-6]]


@cache
def base(kind: str, seed: int) -> Seen:
    """The same motion without a law."""
    return see(kind, seed)


def changed(kind: str, seed: int, law: Effect) -> tuple[np.ndarray, dict[str, float]]:
    """Give what a law changes: displacements [T, V, 3] [m] and the three observables."""
    there, plain = see(kind, seed, law), base(kind, seed)
    return there.points - plain.points, {key: getattr(there, key) - getattr(plain, key) for key in OBSERVED}


def rms_mm(fields: list[np.ndarray]) -> float:
    """Root mean square length of displacements, in mm."""
    return float(1e3 * np.sqrt(np.concatenate([(f**2).sum(-1).ravel() for f in fields]).mean()))


def at_equal_signal(label: str) -> tuple[Effect, float]:
    """Scale a law to SIGNAL_MM over the first seed's motions without a push.

    Returns:
        The law, and the signal that it came to [mm].
    """
    name, shape, amplitude = LAWS[label]
    kind = library()[name]
    parameter = next(p for p in kind.amplitudes if p.name == amplitude)
    value, tried = parameter.typical, []
    for _ in range(TRIALS):
        law = kind(**{amplitude: min(value, parameter.high)}, **shape)
        signal = rms_mm([changed(motion, SEEDS[0], law)[0] for motion in SCALED_IN])
        tried.append((abs(np.log(signal / SIGNAL_MM)), law, signal))
        sys.stdout.write(f"{label}: {law} {signal:.3f} mm\n")
        sys.stdout.flush()
        if tried[-1][0] < np.log(CLOSE):
            break
        value *= float(np.clip(SIGNAL_MM / signal, 0.2, 5.0))
    _, law, signal = min(tried, key=lambda t: t[0])
    return law, signal


def cosine(one: np.ndarray, other: np.ndarray) -> float:
    """Correlation of two response fields."""
    return float((one * other).sum() / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-12))


def measure() -> Figures:
    """Run everything."""
    laws = {label: at_equal_signal(label) for label in LAWS}
    rows: Figures = {}
    for motion in CUTS:
        fields: dict[tuple[str, int], np.ndarray] = {}
        seen: dict[str, list[dict[str, float]]] = {label: [] for label in LAWS}
        for seed in SEEDS:
            for label, (law, _) in laws.items():
                fields[label, seed], found = changed(motion, seed, law)
                seen[label].append({**found, "moved_mm": rms_mm([fields[label, seed]])})
        pairs = {f"{a} | {b}": [cosine(fields[a, s], fields[b, s]) for s in SEEDS] for a, b in combinations(LAWS, 2)}
        plain = [{key: getattr(base(motion, s), key) for key in OBSERVED} for s in SEEDS]
        rows[motion] = {
            "plain": _rounded(plain),
            "changed": {k: _rounded(v) for k, v in seen.items()},
            "cosine": {k: [round(c, 3) for c in v] for k, v in pairs.items()},
        }
        sys.stdout.write(f"{motion} {json.dumps(rows[motion])}\n")
        sys.stdout.flush()
    return {
        "command": COMMAND,
        "seeds": list(SEEDS),
        "spacing_m": SPACING_M,
        "signal_wanted_mm": SIGNAL_MM,
        "load_1min": round(os.getloadavg()[0], 1),
        "laws": {k: {"effect": law.name, **law.values, "signal_mm": round(s, 3)} for k, (law, s) in laws.items()},
        "motions": rows,
    }


def _rounded(rows: list[dict[str, float]]) -> list[dict[str, float | None]]:
    return [{k: None if np.isnan(v) else round(v, 4) for k, v in row.items()} for row in rows]


def table(result: Figures) -> str:
    """Make the two tables: what each law changes, and how alike the responses are."""
    lines = ["| motion | law | moves by [mm] | " + " | ".join(OBSERVED.values()) + " |", "|---" * 6 + "|"]
    for motion, row in result["motions"].items():
        cells = [_spread(row["plain"], key, "") for key in OBSERVED]
        lines.append(f"| `{motion}` | none: in all | | " + " | ".join(cells) + " |")
        for label, seen in row["changed"].items():
            cells = [_spread(seen, "moved_mm", ""), *(_spread(seen, key, "+") for key in OBSERVED)]
            lines.append(f"| | {label} | " + " | ".join(cells) + " |")
    pairs = list(next(iter(result["motions"].values()))["cosine"])
    lines += [
        "",
        "| correlation of responses | " + " | ".join(f"`{m}`" for m in result["motions"]) + " |",
        "|---" * (len(result["motions"]) + 1) + "|",
    ]
    for pair in pairs:
        cells = [_values(row["cosine"][pair], "", 2) for row in result["motions"].values()]
        lines.append(f"| {pair.replace(' | ', ' and ')} | " + " | ".join(cells) + " |")
    laws = "; ".join(f"{label}: {_named(law)}" for label, law in result["laws"].items())
    facts = (
        f"`{result['command']}`. Mean over {len(result['seeds'])} seeds (least to most). Of the laws: what they "
        f"change. In brackets their RMS over the first seed's motions without a push. {laws}."
    )
    lines += ["", facts]
    return "\n".join(lines)


def _named(law: Mapping[str, Any]) -> str:
    amplitude = next(p for p in library()[law["effect"]].amplitudes)
    return f"{law[amplitude.name]:.3g} {amplitude.unit} ({law['signal_mm']:.2f} mm)"


def _spread(rows: list[dict[str, float | None]], key: str, sign: str) -> str:
    values = [row[key] for row in rows]
    return "" if None in values else _values([float(v) for v in values if v is not None], sign, 2)


def _values(values: list[float], sign: str, digits: int) -> str:
    mean, low, high = (f"{v:{sign}.{digits}f}" for v in (float(np.mean(values)), min(values), max(values)))
    return f"{mean} ({low} to {high})"


def main() -> None:
    """Measure (or, with --table, only read), and write the table."""
    if "--table" not in sys.argv[1:]:
        RESULT.write_text(json.dumps(measure(), indent=1) + "\n", encoding="utf-8")
    result = json.loads(RESULT.read_text(encoding="utf-8"))
    sys.stdout.write(table(result) + "\n")


if __name__ == "__main__":
    main()
