"""Digests follow content, not clocks; fingerprints follow what decides the result."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plop.artifacts.digest import DigestCache, content_digest, file_digest, files_below
from plop.artifacts.fingerprint import deciding, fingerprint, plain
from plop.errors import PlopError
from plop.setting_kinds import SAME_RESULT


def test_file_digest_is_sha256(tmp_path: Path):
    (tmp_path / "a").write_bytes(b"content")
    assert file_digest(tmp_path / "a") == hashlib.sha256(b"content").hexdigest()


def test_raw_digest_ignores_times_and_place_but_not_names_or_content(tmp_path: Path):
    def digest(folder: str, files: dict[str, str], age_s: float) -> str:
        for name, text in files.items():
            path = tmp_path / folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            os.utime(path, (1e9 - age_s, 1e9 - age_s))
        root = tmp_path / folder
        return DigestCache(tmp_path / "cache.json").raw_digest(root, files_below(root))

    base = digest("one", {"a": "x", "b/c": "y"}, 0)
    assert digest("two", {"b/c": "y", "a": "x"}, 50) == base
    assert digest("three", {"a": "x", "b/d": "y"}, 0) != base
    assert digest("four", {"a": "x", "b/c": "z"}, 0) != base


def test_cache_notices_a_change_and_fresh_trusts_nothing(tmp_path: Path):
    path = tmp_path / "a"
    path.write_text("one")
    os.utime(path, (1e9, 1e9))
    cache = DigestCache(tmp_path / "cache.json")
    first = cache.digest(path)
    cache.save()
    path.write_text("two")
    os.utime(path, (1e9, 1e9))  # same size, same time: only a fresh look can tell
    again = DigestCache(tmp_path / "cache.json")
    assert again.digest(path) == first
    assert again.digest(path, fresh=True) == file_digest(path) != first
    path.write_text("three")
    assert again.digest(path) == file_digest(path)


def test_recent_files_are_not_cached(tmp_path: Path):
    (tmp_path / "a").write_text("one")
    cache = DigestCache(tmp_path / "cache.json")
    cache.digest(tmp_path / "a")
    cache.save()
    assert not (tmp_path / "cache.json").exists()


@pytest.mark.parametrize("make", [False, True])
def test_missing_or_empty_folder_is_a_clear_error(tmp_path: Path, make: bool):
    if make:
        (tmp_path / "raw").mkdir()
    with pytest.raises(PlopError):
        files_below(tmp_path / "raw")


@given(st.dictionaries(st.text(min_size=1), st.text(alphabet="0123456789abcdef", min_size=4), max_size=4))
def test_content_digest_does_not_depend_on_order(files: dict[str, str]):
    assert content_digest(files) == content_digest(dict(reversed(files.items())))


@dataclass(frozen=True)
class Inner:
    width: int = 3
    program: Annotated[str, SAME_RESULT] = "blender"


@dataclass(frozen=True)
class Config:
    rate: float = 0.1
    sizes: tuple[int, ...] = (1, 2)
    inner: Inner = field(default_factory=Inner)
    threads: Annotated[int, SAME_RESULT] = 1


def test_fingerprint_changes_with_everything_that_decides():
    base = fingerprint("train", 1, deciding(Config()), {"raw": "aa"})
    assert base == fingerprint("train", 1, deciding(Config(threads=8, inner=Inner(program="bpy"))), {"raw": "aa"})
    others = [
        fingerprint("fuse", 1, deciding(Config()), {"raw": "aa"}),
        fingerprint("train", 2, deciding(Config()), {"raw": "aa"}),
        fingerprint("train", 1, deciding(Config(rate=0.2)), {"raw": "aa"}),
        fingerprint("train", 1, deciding(Config(inner=Inner(4))), {"raw": "aa"}),
        fingerprint("train", 1, deciding(Config()), {"raw": "ab"}),
        fingerprint("train", 1, deciding(Config()), {}),
    ]
    assert len({base, *others}) == 1 + len(others)


def test_configuration_with_an_object_has_no_fingerprint():
    with pytest.raises(TypeError):
        plain({"path": Path("x")})
