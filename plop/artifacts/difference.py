"""How two artifacts differ."""

from __future__ import annotations

from plop.artifacts.fingerprint import flat_values
from plop.artifacts.manifest import content_files
from plop.artifacts.store import Artifact, Store


def first_difference(store: Store, one: Artifact, two: Artifact) -> str | None:
    """Name the first difference of two artifacts, starting from the raw data; None when they are equal."""
    a, b = one.manifest, two.manifest
    pair = f"{one.address} and {two.address}"
    if a.stage != b.stage:
        return f"{pair} are of different stages: {a.stage}, {b.stage}"
    for name in sorted(a.inputs.keys() | b.inputs.keys()):
        difference = _input_difference(store, one, two, name)
        if difference:
            return difference
    if a.stage_version != b.stage_version:
        return f"{pair}: stage version {a.stage_version}, {b.stage_version}"
    ours, theirs = dict(flat_values(a.config)), dict(flat_values(b.config))
    for key in sorted(ours.keys() | theirs.keys()):
        left, right = ours.get(key, "(absent)"), theirs.get(key, "(absent)")
        if left != right:
            return f"{pair}: setting {a.stage}.{key} = {left!r}, {right!r}"
    left_files, right_files = content_files(a), content_files(b)
    for name in sorted(left_files.keys() | right_files.keys()):
        if left_files.get(name) != right_files.get(name):
            where = "in both" if name in left_files and name in right_files else "only in one"
            return f"{pair}: same settings and inputs, but {name} differs ({where}): the stage is not deterministic"
    return None


def _input_difference(store: Store, one: Artifact, two: Artifact, name: str) -> str | None:
    a, b = one.manifest.inputs.get(name), two.manifest.inputs.get(name)
    pair = f"{one.address} and {two.address}"
    if a is None or b is None:
        return f"{pair}: only {(two if a is None else one).address} has an input {name}"
    if a["content"] == b["content"]:
        return None
    if "fingerprint" not in a or "fingerprint" not in b:
        sources = ", ".join(str(facts.get("name", facts.get("stage"))) for facts in (a, b))
        return f"{pair}: the raw input {name} differs ({sources})"
    if a["stage"] != b["stage"]:
        return f"{pair}: {name} comes from {a['stage']}, {b['stage']}"
    left, right = store.get(a["stage"], a["fingerprint"]), store.get(b["stage"], b["fingerprint"])
    if left is None or right is None or left.key == right.key:
        return f"{pair}: {name} = {a['stage']}@{a['fingerprint'][:8]}, {b['stage']}@{b['fingerprint'][:8]}"
    return first_difference(store, left, right)
