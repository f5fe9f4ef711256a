"""Whether an artifact was made from another: made again, or by a newer version, the same content counts as the same."""

from __future__ import annotations

from dataclasses import replace

from plop.artifacts.digest import content_digest
from plop.artifacts.lineage import made_from
from plop.artifacts.manifest import Manifest


def test_the_same_content_under_another_address_is_the_same():
    films = Manifest("simulate", "a" * 16, 2, {}, {}, files={"episodes/gel_000.h5": "1" * 64, "logs/run.txt": "2" * 64})
    content = content_digest({"episodes/gel_000.h5": "1" * 64})
    source = {"stage": "simulate", "fingerprint": films.fingerprint, "content": content}
    init = Manifest("fit-init", "b" * 16, 1, {}, {"recordings": source})
    again = replace(films, fingerprint="c" * 16, stage_version=3)
    assert made_from(init, "recordings", films) and made_from(init, "recordings", again)
    other = replace(again, files={"episodes/gel_000.h5": "3" * 64})
    assert not made_from(init, "recordings", other)
    assert made_from(init, "tracks", other), "nobody knows"
