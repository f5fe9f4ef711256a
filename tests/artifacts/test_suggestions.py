"""What a user may have meant by an address, and by a workspace."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import pytest

from plop.artifacts.store import Store
from plop.artifacts.suggestions import age, nearest, workspaces_near
from plop.errors import PlopError

NOW = datetime(2026, 1, 2, tzinfo=UTC)


@dataclass(frozen=True)
class One:
    key: tuple[str, str]
    made: str = ""

    @property
    def address(self) -> str:
        return f"{self.key[0]}@{self.key[1][:8]}"


ALL = [
    One(("ingest", "a1b2c3d4e5")),
    One(("train", "3f9a1c0477")),
    One(("rollout", "77aa00bb11")),
    One(("train", "99ff00ee22")),
]
NAMES = {"base": "train@3f9a1c0477", "gone": "fuse@00"}


@pytest.mark.parametrize(
    ("asked", "first"),
    [
        ("train@3f9b", "base = train@3f9a1c04"),
        ("train@3f9a1c05", "base = train@3f9a1c04"),
        ("bsae", "base = train@3f9a1c04"),
        ("trian@99ff", "train@99ff00ee"),
        ("rolout@latest", "rollout@77aa00bb"),
        ("77aa00bb", "rollout@77aa00bb"),
        ("ingest", "ingest@a1b2c3d4"),
        ("Ingest@A1B2", "ingest@a1b2c3d4"),
    ],
)
def test_the_nearest_comes_first(asked, first):
    assert nearest(asked, ALL, NAMES)[0] == first


def test_the_latest_are_told_where_nothing_is_near():
    assert nearest("qqqq", ALL, NAMES)[0] == "train@99ff00ee"
    assert nearest("qqqq", [], {}) == []


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(5, "5 s ago"), (300, "5 min ago"), (7200, "2 h ago"), (5 * 86400, "5 days ago"), (-3, "0 s ago")],
)
def test_age(seconds, text):
    assert age((NOW - timedelta(seconds=seconds)).isoformat(), NOW) == text
    assert age("", NOW) == age("yesterday", NOW) == age("2026-01-01", NOW) == ""


def test_a_workspace_that_is_not_there_names_those_that_are(tmp_path):
    for name in ("demo", "other"):
        (tmp_path / name / "artifacts" / "train" / "3f9a").mkdir(parents=True)
        (tmp_path / name / "artifacts" / "train" / "3f9a" / "manifest.json").touch()
    (tmp_path / "dmeos" / "artifacts").mkdir(parents=True)  # a folder of that name that holds none
    for folder, near in (("dmeo", "demo"), ("demo/artifacts/train", "demo"), ("othr/deep/er", "other")):
        assert workspaces_near(tmp_path / folder)[0] == tmp_path / near
    with pytest.raises(PlopError) as caught:
        Store(tmp_path / "dmeo").find("train@latest")
    told = caught.value
    assert "no such workspace" in told.problem and f"-w {tmp_path / 'demo'}" in str(told.fix)
    assert "plop ingest" in str(told.fix) and not (tmp_path / "dmeo").exists()
    with pytest.raises(PlopError, match="no workspace here yet"):
        Store(tmp_path).find("base")
