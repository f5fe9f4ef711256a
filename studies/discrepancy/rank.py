"""Rank laws in sets of collect.py. usage: rank.py EV.pkl ref|twins SET[,SET...] ["Spread(...)"]"""

from __future__ import annotations

import itertools
import pickle
import sys
from typing import Any

import numpy as np
from discrepancy import Evidences, Field, Spread, noise_weights
from evidence import Evidence
from held_out import HeldOut, Setting, score
from scipy.spatial import cKDTree

from plop.diagnosis.candidates import candidates_of
from plop.diagnosis.evidence import compared_frames
from plop.physics.effects.library import library

REFIT = {"stiffness": 0.3, "damping": 1.0, "table_friction": 0.2, "blade_friction": 0.2}
"""Base parameters that are refitted: prior standard deviation, in typical amplitudes."""
MULTIPLES = (-3, -2.2, -1.5, -1, -0.65, -0.45, -0.3, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.3, 0.45, 0.65, 1, 1.5, 2.2, 3)
BEFORE = (-1, -0.3, 0.05, 0.1, 0.2, 0.3, 0.65, 1)
"""Amplitudes at which a law may act in all episodes, the references too."""
Knot = tuple[str, str, str, float]
"""Candidate, kind, column, multiple of the typical amplitude."""


def at(here: Any, other: Any) -> np.ndarray:
    """Read a twin recording off at the material points of this one."""
    near = cKDTree(other.points[0]).query(here.points[0], k=6)[1]
    return np.median((other.points - other.points[:1])[:, near], axis=2) + here.points[:1]


def evidence(e: Any, points: np.ndarray, answers: dict, key: tuple, explained: bool, knots: list[Knot]) -> Evidence:
    """Reduce one episode; knots that were not run respond with 0."""
    frames = compared_frames(len(e.times))

    def pooled(values: np.ndarray) -> np.ndarray:
        return e.pooled((values - values[:1])[frames])

    def response(knot: Knot) -> np.ndarray:
        run = answers.get((*key, knot))
        return np.zeros_like(mean) if run is None or run[0] is None else pooled(run[0] - plain)

    plain = answers[(*key, "plain")][0]
    runs = [answers[(*key, name)][0] for name in ("plain", "plain0.86", "plain1.16")]
    predicted = [pooled(run) for run in runs if run is not None]
    mean, seen = np.mean(predicted, 0), e.seen_patches[frames]
    size = float(np.ptp(e.vertices, axis=0).max())
    foot = np.array([*e.vertices.mean(0)[:2], e.vertices[:, 2].min()])
    ends = np.stack([e.tool.vertices.min(0), e.tool.vertices.max(0)])
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in itertools.product((0, 1), repeat=3)])
    poses = e.tool.world_from_tool
    steps = np.linspace(0, len(poses) - 1, 20).round().astype(int)
    typical = {k[0].split("(")[0]: k for k in knots if k[3] == 1.0}
    return Evidence(
        e.name,
        explained,
        (pooled(points) - mean) * seen[..., None],
        mean,
        e.patch_noise_m,
        np.sqrt(np.var(predicted, 0, ddof=1).mean(-1)) if len(predicted) > 1 else np.zeros(mean.shape[:2]),
        seen,
        (e.pooled(e.points[0]) - foot) / size,
        np.stack([(e.pooled(plain[f]) - poses[f][:3, 3]) @ poses[f][:3, :3] / size for f in frames]),
        frames / (len(e.times) - 1),
        np.stack([(corners @ poses[i][:3, :3].T + poses[i][:3, 3] - foot) / size for i in steps]),
        float(e.times[-1]),
        np.stack([scale * response(typical[name]) for name, scale in REFIT.items()], -1) * seen[..., None, None],
        np.stack([response(knot) for knot in knots], -1) * seen[..., None, None],
    )


def load(path: str, which: str, twins: bool) -> tuple[list[Evidence], list[Knot], list[int]]:
    """Give the episodes, the knots that ran in all to explain, and which of these ran in all references."""
    with open(path, "rb") as file:
        stored = pickle.load(file)  # noqa: S301 -- made by collect.py on this machine
    answers, home, tests = stored["answers"], stored["sets"]["null"], stored["sets"][which]
    references = home if twins else stored["ref"]

    def ran(episodes: Any, knot: Knot) -> bool:
        return all((e.name, knot) in answers and answers[(e.name, knot)][0] is not None for e in episodes)

    every = [
        (c.key, c.kind, column.key, multiple)
        for c in candidates_of(library())
        for column in c.columns
        for multiple in (1.0, 0.3, 3.0, -1.0)
    ]
    knots = [knot for knot in every if ran(home, knot)]
    found = []
    for e in home:
        other = next(t for t in tests if t.name == e.name)
        points = e.points if which == "null" else at(e, other)
        found.append(evidence(e, points, answers, (e.name,), True, knots))
    found += [evidence(e, e.points, answers, (e.name,), False, knots) for e in references]
    return found, knots, [k for k, knot in enumerate(knots) if ran(references, knot)]


def curve(knots: dict[float, int], multiple: float) -> dict[int, float]:
    """Interpolate between the knots of one column, and 0."""
    places = sorted([0.0, *knots])
    j = int(np.clip(np.searchsorted(places, multiple) - 1, 0, len(places) - 2))
    share = (multiple - places[j]) / (places[j + 1] - places[j])
    pairs = ((places[j], 1 - share), (places[j + 1], share))
    return {knots[place]: weight for place, weight in pairs if place != 0 and abs(weight) > 1e-12}


def settings_of(knots: list[Knot], shared: list[int]) -> tuple[dict[str, list[Setting]], list[Setting]]:
    """List the settings of every law, which may act in all episodes and otherwise here; and those of the null."""
    tree: dict[str, dict[str, dict[float, int]]] = {}
    for number, (candidate, _, column, multiple) in enumerate(knots):
        tree.setdefault(candidate, {}).setdefault(column, {})[multiple] = number
    laws: dict[str, list[Setting]] = {}
    null = [Setting("-", (), 0.0, ())]
    for candidate, columns in tree.items():
        found = laws.setdefault(candidate.split("(")[0], [])
        ends = [(min(0.0, *own), max(own)) for own in columns.values()]
        if len(columns) > 1:
            axes = [[0.0] + [m for m in MULTIPLES if low <= m <= high and abs(m) in (0.1, 0.3, 0.65, 1, 1.5, 3)]
                    for low, high in ends]  # fmt: skip
            for combination in itertools.product(*axes):
                here: dict[int, float] = {}
                for own, multiple in zip(columns.values(), combination, strict=True):
                    here |= curve(own, multiple) if multiple else {}
                if here:
                    found.append(Setting(candidate, combination, 0.0, tuple(here.items())))
            continue
        own, (low, high) = next(iter(columns.values())), ends[0]
        before = {multiple: number for multiple, number in own.items() if number in shared}
        allowed = [m for m in BEFORE if before and min(0.0, *before) <= m <= max(before)]
        null += [Setting(candidate, (), m, (), tuple(curve(before, m).items())) for m in allowed]
        for first in [0.0, *allowed]:
            for then in [*(m for m in MULTIPLES if low <= m <= high), 0.0]:
                if abs(then - first) < 0.04:
                    continue
                everywhere = curve(before, first) if first else {}
                here = curve(own, then) if then else {}
                here = {k: here.get(k, 0.0) - everywhere.get(k, 0.0) for k in {*here, *everywhere}}
                found.append(
                    Setting(candidate, (then - first,), first, tuple(here.items()), tuple(everywhere.items()))
                )
    return laws, null


def main() -> None:
    """Print the ranking of each set."""
    path, reference, sets = sys.argv[1:4]
    spread = eval(sys.argv[4], {"Spread": Spread}) if len(sys.argv) > 4 else Spread(0.06, 0.3, 0.97, 1e-4, 0.05, 0.005)
    for which in sets.split(","):
        episodes, knots, shared = load(path, which, reference == "twins")
        typical = [k for k, knot in enumerate(knots) if knot[3] == 1.0]
        like = [k for k in typical if knots[k][0].split("(")[0] not in (*REFIT, "density")]
        evidences = Evidences(episodes, len(REFIT), like, 24)
        enclosing = [1.5 * e.responses[..., typical].reshape(e.residual.size, -1) * e.explained for e in episodes]
        weights = noise_weights(evidences, spread, evidences.residual, enclosing)
        held = HeldOut(evidences, Field(evidences, spread, weights), evidences.residual, len(knots), shared)
        laws, null = settings_of(knots, shared)
        scores, plain = score(held, laws, null)
        print(f"== {which}, reference {reference}: null {plain.sum():.0f}")
        for s in scores[:6]:
            chosen = f"{s.best.candidate} {s.best.before:g} {tuple(map(float, s.best.multiples))}"
            print(f"   {s.law:16s} {s.total:8.1f} +- {s.error:6.1f} ({(s.gain > 0).sum()}/{len(s.gain)}) {chosen}")


if __name__ == "__main__":
    main()
