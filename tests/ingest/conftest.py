"""A good raw episode that tests of the DROID stage copy and break."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.support.droid_scene import make_episode


@pytest.fixture(scope="module")
def pristine(tmp_path_factory) -> Path:
    """One good episode with scan; tests copy it and break the copy."""
    root = tmp_path_factory.mktemp("droid") / "raw"
    make_episode(root, notes={"scan": [0, 4]})
    return root


@pytest.fixture
def raw(pristine, tmp_path) -> Path:
    return Path(shutil.copytree(pristine, tmp_path / "raw"))
