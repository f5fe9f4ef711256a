"""The search through the library: every hypothesis on the same evidence, and how often chance finds as much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from plop.diagnosis.evidence.amounts import Contrast, own_amounts, typical
from plop.diagnosis.evidence.contrast import Products, roots
from plop.diagnosis.evidence.discrepancy import SPREAD, Field, Spread, columns_of
from plop.diagnosis.evidence.evidence import Evidence
from plop.diagnosis.responses.hypotheses import Candidate, Hypothesis, hypotheses_of, run_key
from plop.diagnosis.responses.table import Table
from plop.diagnosis.scores.calibration import ByChance, balanced, between_repeats, strongest, ways_to_deal
from plop.diagnosis.scores.difference import Difference
from plop.diagnosis.scores.score import Score
from plop.diagnosis.scores.without_reference import chance_without_reference

ENOUGH_WAYS = 100
"""Ways of dealing episodes out that are needed for a chance of 1 %."""


class Search:
    """Evidence of recordings and reference, and the hypotheses tried on it."""

    def __init__(
        self,
        tables: Sequence[Table],
        candidates: Sequence[Candidate],
        base: Sequence[Hypothesis],
        spread: Spread = SPREAD,
    ) -> None:
        """Run every law at the amplitudes at which it is tried first.

        Args:
            tables: The recordings to explain, then the reference, if there is one.
            candidates: The laws.
            base: The base's own parameters at one standard deviation of what `identify` may be off.
            spread: How large each part of the discrepancy is.
        """
        self.tables, self.candidates = list(tables), list(candidates)
        self.here = np.repeat([True, False][: len(tables)], [len(table.episodes) for table in tables])
        self.evidence: list[Evidence] = [evidence for table in tables for evidence in table.evidence]
        self._coarse = all(table.survey is not table.full for table in tables)
        self.first = tuple(self._run([replace(h, coarse=self._coarse) for h in hypotheses_of(candidates)], base))
        self.hypotheses: list[Hypothesis] = list(self.first)
        columns = [self.response(hypothesis) for hypothesis in self._run(base)]
        shapes = [e.residual.shape for e in self.evidence]
        stacked = [
            np.stack([c[e] for c in columns], -1) if columns else np.zeros((*shape, 0))
            for e, shape in enumerate(shapes)
        ]
        self._base, self.spread = stacked, spread
        self.field = Field(self.evidence, stacked, spread)
        self.known: list[np.ndarray] = [np.zeros(shape) for shape in shapes]
        """What has been found already, and is taken off the residuals, [F, K, 3] [m] each."""
        self.fitted = self.field.refitted(self._residuals)

    def add(self, hypotheses: Sequence[Hypothesis]) -> None:
        """Run more hypotheses; those that are unstable, or move nothing, are left out."""
        known = {h.key for h in self.hypotheses if len(h.runs) == 1 and not h.coarse}
        self.hypotheses += self._run([h for h in hypotheses if h.key not in known])

    def _run(self, hypotheses: Sequence[Hypothesis], others: Sequence[Hypothesis] = ()) -> list[Hypothesis]:
        """Run hypotheses, and others at the same time that are asked for later; give those that can be used."""
        for table in self.tables:
            table.respond([*hypotheses, *others])
        return [h for h in hypotheses if not any(t.trouble(h) for t in self.tables) and self._moves(h)]

    def failed(self) -> dict[str, str]:
        """Give the laws of which no setting could be run, and why."""
        troubles = {key: why for table in self.tables for key, why in table.survey.failed.items()}
        run = {h.effect for h in hypotheses_of(self.candidates) if not any(run_key(s) in troubles for s, _ in h.runs)}
        return {
            h.effect: next(troubles[key] for s, _ in h.runs if (key := run_key(s)) in troubles)
            for h in hypotheses_of(self.candidates)
            if h.effect not in run
        }

    def _moves(self, hypothesis: Hypothesis) -> bool:
        return any(np.any(changes) for changes in self.tables[0].response(hypothesis))

    def response(self, hypothesis: Hypothesis) -> list[np.ndarray]:
        """Give what a hypothesis changes in every episode, [F, K, 3] [m] each."""
        return [changes for table in self.tables for changes in table.response(hypothesis)]

    @cached_property
    def ways(self) -> np.ndarray:
        """Ways of dealing the episodes out, the real one first, [N, E]; without a reference only that one."""
        if self.here.all():
            return np.ones((1, len(self.here)))
        return ways_to_deal(self.here, self.kinds, ENOUGH_WAYS)

    @cached_property
    def law_ways(self) -> np.ndarray:
        """Balanced ways, by which chance is measured: between repeats, where every motion was repeated."""
        return balanced(between_repeats(self.here, self.field.groups, self.ways))

    def beside(self, score: Score) -> Search:
        """Search what a law leaves that has been found: it is taken off the episodes to explain."""
        other = self._copy()
        other.known = [known + change for known, change in zip(self.known, self._change(score), strict=True)]
        other.first = tuple(h for h in self.first if h.effect != score.hypothesis.effect)
        other.hypotheses = [h for h in self.hypotheses if h.effect != score.hypothesis.effect]
        return other

    def _copy(self) -> Search:
        other = object.__new__(Search)
        computed = {"law_ways", "_by_chance", "_tried", "_strongest", "_chances", "difference"}
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in computed})
        return other

    def _change(self, score: Score) -> list[np.ndarray]:
        """Give what a law does where it was found, [F, K, 3] [m] for each episode; 0 in the reference."""
        response = self.response(score.hypothesis)
        return [score.amount * changes * here for changes, here in zip(response, self.here, strict=True)]

    def reweighted(self, score: Score) -> Search:
        """Weigh patches and frames by what they leave with laws that were found, which are no chance any more.

        The search itself weighs them without any law, so that no way of dealing the episodes out is preferred; a strong
        law then looks as if parts had broken loose.
        """
        other = self._copy()
        change = [known + c for known, c in zip(self.known, self._change(score), strict=True)]
        left = [replace(e, residual=e.residual - c) for e, c in zip(self.evidence, change, strict=True)]
        other.field = Field(left, self._base, self.spread)
        other.fitted = [f + c for f, c in zip(other.field.refitted([e.residual for e in left]), change, strict=True)]
        return other

    @cached_property
    def difference(self) -> Difference:
        """What else is in the recordings than in the reference, whatever it is."""
        left = [f - known for f, known in zip(self.fitted, self.known, strict=True)]
        return Difference(
            self.field, self.evidence, self._residuals, left, self.here, self.ways, self.kinds, self.spread
        )

    @property
    def _residuals(self) -> list[np.ndarray]:
        return [e.residual - known for e, known in zip(self.evidence, self.known, strict=True)]

    def products(self, hypotheses: Sequence[Hypothesis]) -> list[Products]:
        """Multiply hypotheses with the evidence, see `Products`."""
        return self.field.products([self.response(h) for h in hypotheses], self._residuals) if hypotheses else []

    @cached_property
    def _by_chance(self) -> ByChance:
        """Strength that the search over the first hypotheses finds for each way of dealing out.

        What the law of the strongest does is taken off in all its settings, as much as each episode shows of it beyond
        what all show, as if all episodes that tell of it had been free.
        """
        best, products = max(self._tried, key=lambda pair: self._found(pair[1]))
        columns = columns_of([self.response(h) for h in self.first if h.effect == best.effect])
        amounts = own_amounts(*self.field.multiplied(columns, self._residuals), self.here)
        changes = zip(self._residuals, columns, amounts, strict=True)
        left = [residual - (column @ amount).reshape(residual.shape) for residual, column, amount in changes]
        without = strongest(self.field.products([self.response(h) for h in self.first], left), self.law_ways)
        scale = np.sqrt((products.freedom + 2) / products.freedom)
        return ByChance(scale * without, len(self.first), len(self.here))

    def _found(self, products: Products) -> float:
        return float(products.strength(self.here[None].astype(float))[0])

    def chance_of(self, effect: str) -> float:
        """Give the chance of a law, with the amplitudes that were run before any result was seen.

        Amplitudes run later were chosen by what the recordings show. Were they to count, the real way of dealing the
        episodes out would be searched more closely than all others.
        """
        return self._chances.get(effect, 1.0)

    @cached_property
    def _chances(self) -> dict[str, float]:
        own = self._strongest.items()
        return {law: self._by_chance.chance(self._found(products), products.freedom) for law, products in own}

    @cached_property
    def _strongest(self) -> dict[str, Products]:
        """Of the hypotheses of every law, the one that is found most strongly."""
        found: dict[str, Products] = {}
        for hypothesis, products in sorted(self._tried, key=lambda pair: -self._found(pair[1])):
            found.setdefault(hypothesis.effect, products)
        return found

    @cached_property
    def _tried(self) -> list[tuple[Hypothesis, Products]]:
        return list(zip(self.first, self.products(self.first), strict=True))

    def dealt(self, way: int) -> Search:
        """Search as if another way of dealing the episodes out were the real one: how a null is examined closely."""
        other = self._copy()
        other.here = self.ways[way] > 0
        other.__dict__["ways"] = np.concatenate([self.ways[way : way + 1], np.delete(self.ways, way, 0)])
        return other

    def alarmed(self, alarm: float) -> bool:
        """Tell whether a law, or a difference whatever it is, has so small a chance."""
        laws = {h.effect for h in self.first}
        differs = self.difference.p is not None and self.difference.p <= alarm
        return differs or any(self.chance_of(law) <= alarm for law in laws)

    def critical(self, p: float, effect: str) -> float:
        """Strength of a law that has so small a chance."""
        own = self._strongest.get(effect)
        return np.inf if own is None else self._by_chance.critical(p, own.freedom)

    def scores(self) -> list[Score]:
        """Score all hypotheses, best first."""
        judged = self._judged()
        found = [self._score(h, p) for h, p in zip(judged, self.products(judged), strict=True)]
        return sorted(found, key=lambda score: (-score.strength, score.hypothesis.key))

    def _judged(self) -> list[Hypothesis]:
        """Leave out what a survey says of a law where the engine itself has been run with it."""
        known = {h.candidate.key for h in self.hypotheses if not h.coarse}
        return [h for h in self.hypotheses if not h.coarse or h.candidate.key not in known]

    def score_of(self, hypothesis: Hypothesis, p: float | None = None) -> Score:
        """Score one hypothesis, of which the chance may be known."""
        return self._score(hypothesis, self.products([hypothesis])[0], p)

    def _score(self, hypothesis: Hypothesis, products: Products, p: float | None = None) -> Score:
        alone = products.typical(self.here)
        amount = max(alone.amount, 0.0)
        gains, amounts = (values[0] for values in products.held_out(self.here[None].astype(float)))
        if p is None:
            strength = float(roots(gains).sum())
            p = chance_without_reference(strength) if self.here.all() else self.chance_of(hypothesis.effect)
        size_m = amount * self.size_m(hypothesis)
        explained = partial(self._explained, hypothesis, amounts[self.here])
        directed = partial(self._directed, hypothesis, alone)
        return Score(hypothesis, products, amount, directed, p, gains, int(self.here.sum()), size_m, explained)

    def _directed(self, hypothesis: Hypothesis, alone: Contrast) -> Contrast:
        """Fit a law with two amplitudes along its direction and across; give what is known already of any other law."""
        across = hypothesis.across(self._coarse)
        if across is None or alone.amount <= 0:
            return alone
        columns = columns_of([self.response(hypothesis), self.response(across)])
        found = typical(*self.field.multiplied(columns, self._residuals), self.here, self.field.repeats)
        return found if np.isfinite(found.error) and found.amount > 0 else alone

    def size_m(self, hypothesis: Hypothesis) -> float:
        """RMS displacement that a hypothesis makes in the episodes to explain [m]."""
        response = self.tables[0].response(hypothesis)
        return float(np.sqrt(np.mean([(changes**2).sum(-1).mean() for changes in response])))

    def _explained(self, hypothesis: Hypothesis, amounts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Take a law off the episodes to explain, the base refitted beside it; see `Score.explained`."""
        each, response = np.flatnonzero(self.here).tolist(), self.response(hypothesis)
        changes = [np.zeros_like(r) for r in response]
        for k, amount in zip(each, amounts, strict=True):
            changes[k] = amount * response[k]
        after = self.field.refitted([r - change for r, change in zip(self._residuals, changes, strict=True)])
        without = np.array([self.squares(k, after[k] + changes[k]) for k in each])
        return without, without - np.array([self.squares(k, after[k]) for k in each])

    def squares(self, episode: int, residual: np.ndarray) -> float:
        """Mean squared error of an episode in units of its expectation, patches that broke loose counting less."""
        weights = self.field.noise.weights[episode]
        return float((weights * (residual.reshape(-1, 3) ** 2).sum(1)).sum() / (3 * max((weights > 0).sum(), 1)))

    def sizes(self) -> np.ndarray:
        """Mean squared error of every episode without a law, the base refitted, [E]."""
        return np.array([self.squares(k, self.fitted[k] - self.known[k]) for k in range(len(self.here))])

    @property
    def kinds(self) -> list[str]:
        """Kind of motion of every episode."""
        return [kind for table in self.tables for kind in table.kinds]

    @property
    def excess(self) -> float:
        """Mean squared error of the recordings beyond that of the reference, in units of its expectation."""
        sizes = self.sizes()
        return float(sizes[self.here].mean() - sizes[~self.here].mean())
