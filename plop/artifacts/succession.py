"""Which artifact replaced which: the latest of each line of work."""

from __future__ import annotations

from collections.abc import Mapping

from plop.artifacts.lineage import Key, closure, parents
from plop.artifacts.store import Artifact


def replacements(known: Mapping[Key, Artifact], names: Mapping[str, str]) -> dict[Key, Artifact]:
    """Map each artifact to its replacement: a later one with other content; itself where there is none.

    Args:
        known: All artifacts, least recently used first.
        names: Name -> full address.
    """
    latest = _Succession(known, names).latest()
    return {
        key: old if new.content == old.content or _differ_in_seed_only(new, old) else new
        for key, old in known.items()
        for new in [latest[key]]
    }


def latest_lines(artifacts: list[Artifact], names: Mapping[str, str]) -> list[Artifact]:
    """Keep the latest of each stage, environment and seed, named ones, and the ancestors of these.

    Args:
        artifacts: All artifacts, least recently used first.
        names: Name -> full address.
    """
    by_key = {artifact.key: artifact for artifact in artifacts}
    latest = {(a.manifest.stage, a.manifest.environment, a.manifest.config.get("seed")): a for a in artifacts}
    named = [a for a in artifacts if "@".join(a.key) in set(names.values())]
    keep = set().union(*(closure(by_key, a) for a in [*latest.values(), *named]))
    return [artifact for artifact in artifacts if artifact.key in keep]


class _Succession:
    """Which artifact replaced which.

    A more recent artifact of the same stage replaces another one when it was made from the same things: from the same
    environment and raw inputs, and, input by input, from the same artifact or one that replaced it. A name keeps what
    has it: sets of recordings, models and verdicts with names of their own coexist, and so does everything
    made from them, until the name is given to another one.
    """

    def __init__(self, known: Mapping[Key, Artifact], names: Mapping[str, str]) -> None:
        """Index all artifacts, least recently used first; names: name -> "<stage>@<fingerprint>"."""
        self._known = known
        self._age = {key: place for place, key in enumerate(known)}
        self._named = set(names.values())
        self._found: dict[tuple[Key, Key], bool] = {}

    def latest(self) -> dict[Key, Artifact]:
        """Return the most recent replacement of each."""
        alike: dict[tuple[str, frozenset[str]], list[Artifact]] = {}
        for artifact in self._known.values():
            alike.setdefault((artifact.key[0], self._raw(artifact)), []).append(artifact)
        return {
            old.key: next(new for new in reversed(group) if new is old or self._replaced(old.key, new.key))
            for group in alike.values()
            for old in group
        }

    def _replaced(self, old: Key, new: Key) -> bool:
        if old == new:
            return True
        if (old, new) not in self._found:
            self._found[old, new] = self._newer(old, new) and self._made_alike(old, new)
        return self._found[old, new]

    def _newer(self, old: Key, new: Key) -> bool:
        known = old in self._known and new in self._known
        return known and old[0] == new[0] and "@".join(old) not in self._named and self._age[old] < self._age[new]

    def _made_alike(self, old: Key, new: Key) -> bool:
        before, after = parents(self._known[old]), parents(self._known[new])
        return all(name in after and self._replaced(key, after[name]) for name, key in before.items())

    def _raw(self, artifact: Artifact) -> frozenset[str]:
        found = {artifact.manifest.environment}
        for key in closure(self._known, artifact):
            first = self._known.get(key)
            if first is not None and not parents(first):
                found |= {str(facts.get("name", "")) for facts in first.manifest.inputs.values()}
        return frozenset(found)


def _differ_in_seed_only(one: Artifact, two: Artifact) -> bool:
    """Two seeds of the same thing coexist; neither replaces the other."""
    a, b = one.manifest, two.manifest
    seedless = [{key: value for key, value in m.config.items() if key != "seed"} for m in (a, b)]
    return a.config != b.config and seedless[0] == seedless[1] and a.inputs == b.inputs
