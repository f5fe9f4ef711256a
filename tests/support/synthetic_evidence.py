"""Evidence made of known mixtures of smooth response fields, without any engine; for tests and `verdict_chances`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from plop.diagnosis.candidates import Candidate, Column
from plop.diagnosis.evidence import Evidence, octants
from plop.diagnosis.screen import Screen
from plop.diagnosis.state import State

FRAMES, PATCHES = 6, 32
NOISE_M = 2e-4
LAWS = ("stiffness", "tilt", "swelling", "viscosity", "drag", "fibres")
_KINDS = {"stiffness": "base", "drag": "decoy"}


def candidate(name: str, *, low: float = -10.0, high: float = 10.0) -> Candidate:
    column = Column(name, "a", "-", (), 1.0, low, high)
    return Candidate(name, _KINDS.get(name, "physics"), (column,))


def key(name: str) -> str:
    return candidate(name).columns[0].key


CANDIDATES = [candidate(name) for name in LAWS]


def smooth_field(generator: np.random.Generator, places: np.ndarray, size_m: float) -> np.ndarray:
    """Draw a displacement that grows in time and is linear in the place, [F, K, 3]."""
    ramp = (np.arange(1, FRAMES + 1) / FRAMES) ** generator.uniform(0.5, 2)
    field_ = generator.normal(0, 1, 3) + (places / 0.02) @ generator.normal(0, 1, (3, 3))
    return size_m * ramp[:, None, None] * field_ / np.sqrt((field_**2).mean())


def episode(
    generator: np.random.Generator,
    name: str,
    amplitudes: dict[str, float],
    *,
    noise_m: float = NOISE_M,
    laws: tuple[str, ...] = LAWS,
    misfit_m: float = 0.0,
    rough_m: float = 0.0,
    take: int = 0,
) -> Evidence:
    """One episode in which the base misses `amplitudes` of some laws, and noise.

    It may also err by itself: smoothly over the object (`misfit_m`), or at each point in another way (`rough_m`).
    Another `take` of the same motion differs in noise and misfit only.
    """
    places = generator.uniform(-0.03, 0.03, (PATCHES, 3))
    responses = {key(law): smooth_field(generator, places, 1e-3) for law in laws}
    motion = smooth_field(generator, places, 5e-3)
    chance = generator.spawn(1 + take)[-1]
    residual = chance.normal(0, noise_m, (FRAMES, PATCHES, 3))
    for law, value in amplitudes.items():
        residual = residual + value * responses[key(law)]
    if misfit_m:
        residual = residual + smooth_field(chance, places, misfit_m)
    if rough_m:
        residual = residual + chance.normal(0, rough_m, residual.shape)
    return Evidence(
        name,
        np.arange(1, FRAMES + 1),
        residual,
        motion,
        np.full(PATCHES, noise_m),
        responses,
        octants(places),
        np.zeros((FRAMES, PATCHES)),
    )


def episodes(
    seed: int, amplitudes: dict[str, float] | None = None, *, count: int = 6, **more: object
) -> list[Evidence]:
    generator = np.random.default_rng(seed)
    return [episode(generator, f"e{k}", amplitudes or {}, **more) for k in range(count)]  # type: ignore[arg-type]


@dataclass
class FakeTable:
    """Stands in for `Table`: evidence that is there already."""

    rows: list[Evidence]
    dropped: dict[str, str] = field(default_factory=dict)

    @property
    def kinds(self) -> list[str]:
        """All motions are of one kind."""
        return ["press"] * len(self.rows)

    def evidence(self) -> list[Evidence]:
        """Give it as it is."""
        return self.rows


def state(
    measured: list[Evidence], reference: list[Evidence] | None = None, candidates: list[Candidate] = CANDIDATES
) -> State:
    tables = [FakeTable(rows) for rows in (measured, reference) if rows is not None]
    return State(tables, candidates)  # type: ignore[arg-type]


def screen(measured: list[Evidence], candidates: list[Candidate] = CANDIDATES) -> Screen:
    return state(measured, candidates=candidates).screen
