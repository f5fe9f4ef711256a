"""One run of a missing-physics benchmark: what was hidden, what was said of it, and what follows from both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from typing import Any

from plop.finite import json_ready

JUDGED = 3
"""Laws of each ranking whose parameters and tests are kept."""
_TESTS = ("p", "strength", "gain_error", "reasons")
"""What is kept of how each of them was tested."""
_NO_GAP = 1.1
"""Error over the reference's below which there is nothing to close."""
_REFITTED = "stiffness"
_NAMING = ("EFFECT", "CONFOUNDED", "PARTLY", "BASE PARAMETER")


class Group(StrEnum):
    """What a run hides."""

    SINGLE = "single"
    NULL = "null"
    BASE = "base"
    DECOY = "decoy"
    PAIR = "pair"
    OUTSIDE = "outside"
    """A law that the library of the diagnosis lacks."""
    SENSOR = "sensor"
    UNREACHABLE = "unreachable"
    """No amplitude in the law's range gives the wanted signal: shown, and not counted."""


@dataclass(frozen=True)
class Row:
    """One run as the result files hold it; what a run does not know is None there, and left out of the file."""

    name: str
    set: Group
    seed: int
    hidden: dict[str, dict[str, float]]
    """Effect -> its parameters."""
    snr: float
    """RMS displacement by what is hidden over the noise [-]."""
    verdict: str
    named: list[str] = field(default_factory=list)
    """The likeliest first."""
    wanted: float | None = None
    """Signal that was asked for."""
    fault: str | None = None
    judged_by: int | None = None
    """Version of `diagnose`."""
    base: dict[str, float] | None = None
    """Estimates of the base's material."""
    rms_mm: float | None = None
    """RMS displacement by what is hidden."""
    text: str | None = None
    ranking: list[str] | None = None
    ranks: list[int] | None = None
    """Rank of each hidden effect, from 1."""
    error: float | None = None
    floor: float | None = None
    left: float | None = None
    """Mean squared whitened error: of the base, of the reference, and with what is named."""
    change_p: float | None = None
    """Chance that recordings and reference differ by as much where nothing is hidden."""
    closed: float | None = None
    """Share of that difference which goes away with what is named; older rows have errors only."""
    parameters: dict[str, dict[str, dict[str, Any]]] | None = None
    gains: dict[str, float] | list[float] | None = None
    """Effect -> share of the held-out error that it explains (older rows: of the ranking, without names)."""
    tests: dict[str, dict[str, Any]] | None = None
    dropped: dict[str, str] | None = None
    engine_runs: int | None = None
    seconds: float | None = None
    next_verdict: str | None = None
    next_named: list[str] | None = None
    """Of pairs: the verdict once more, with what was named first added to the base."""
    baselines: dict[str, Any] | None = None
    """What other methods say of the same evidence."""
    response: dict[str, float] | None = None
    """Size and direction of the engine's response beside the true one's; see `response_error`."""
    amplitude_off: float | None = None
    amplitude_held: list[bool] | None = None
    """Of rows that were stored without parameters; see `amplitude`."""

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> Row:
        """Read a stored row; keys that only older versions wrote are left out."""
        known = {f.name for f in fields(cls)}
        return cls(**{**{key: value for key, value in row.items() if key in known}, "set": Group(row["set"])})

    def to_json(self) -> dict[str, Any]:
        """Give what is known, as JSON types."""
        return {key: value for key, value in json_ready(asdict(self)).items() if value is not None}

    @property
    def names_something(self) -> bool:
        """Tell whether the verdict names physics."""
        return self.verdict in _NAMING

    @property
    def first_is_hidden(self) -> bool:
        """Tell whether what is named first is hidden."""
        return bool(self.named) and self.named[0] in self.hidden

    @property
    def some_is_hidden(self) -> bool:
        """Tell whether something of the named is hidden."""
        return bool({*self.named} & {*self.hidden})

    def amplitude(self) -> tuple[float, list[bool]]:
        """Compare the amplitude of what is named first with the hidden one.

        Returns:
            Length of the difference over the length of the truth (several components of a vector are one amplitude),
            and for each component whether its 95 % interval holds the truth.
        """
        if self.parameters is None:
            assert self.amplitude_off is not None and self.amplitude_held is not None
            return self.amplitude_off, self.amplitude_held
        truth, found = self.hidden[self.named[0]], self.parameters.get(self.named[0], {})
        fitted = {key: found[key] for key in truth if key in found and not found[key].get("chosen")}
        off = sum((entry["value"] - truth[key]) ** 2 for key, entry in fitted.items()) ** 0.5
        length = sum(truth[key] ** 2 for key in fitted) ** 0.5
        return off / length, [e["low"] is not None and e["low"] <= truth[k] <= e["high"] for k, e in fitted.items()]

    def gap_closed(self) -> float | None:
        """Give the share of the explainable gap that what is named closes; see `_closed`."""
        return self._closed(self.left) if self.closed is None else self.closed

    def closed_by_wrong_law(self) -> float | None:
        """Give the share of the gap that the best law which is not hidden closes in held-out episodes.

        Stiffness, which is refitted with every law, is none of the wrong ones; a law that does harm closes nothing.

        Returns:
            None where the row does not give its laws' gains by their names, or where there is no gap.
        """
        if not isinstance(self.gains, dict) or self.error is None:
            return None
        wrong = [gain for name, gain in self.gains.items() if name not in self.hidden and name != _REFITTED]
        return self._closed(self.error * (1 - max([0.0, *wrong])))

    def _closed(self, left: float | None) -> float | None:
        """Give the share closed where `left` is left; None where the error hardly exceeds the reference's."""
        if not self.floor or self.error is None or self.error <= _NO_GAP * self.floor:
            return None
        return None if left is None else (self.error - left) / (self.error - self.floor)


def judged(facts: Mapping[str, Any], hidden: Mapping[str, Any]) -> dict[str, Any]:
    """Take from the content of diagnosis.json what a row holds of it.

    Args:
        facts: It.
        hidden: Effects that are hidden, by name.
    """
    verdict, ranking = facts["verdict"], [law["effect"] for law in facts["ranking"]]
    kept = {law["effect"]: law for law in facts["ranking"][:JUDGED]}
    return {
        "verdict": verdict["kind"],
        "named": verdict["named"],
        "text": verdict["text"],
        "ranking": ranking,
        "ranks": [ranking.index(name) + 1 for name in hidden if name in ranking],
        "error": facts["error"],
        "floor": facts["floor"],
        "left": verdict["evidence"].get("left"),
        "change_p": verdict["evidence"].get("change_p"),
        "closed": verdict["evidence"].get("closed"),
        "parameters": {name: law["parameters"] for name, law in kept.items()},
        "gains": {name: law["gain"] for name, law in kept.items()},
        "tests": {name: {key: law[key] for key in _TESTS} for name, law in kept.items()},
        "dropped": facts["dropped"],
        "engine_runs": facts["engine_runs"],
    }
