"""One workspace in which every stage has run."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop_cli.app import main
from tests.pipeline.small_set import COMMANDS, arguments, make_workspace


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the workspace; nobody changes it."""
    folder = tmp_path_factory.mktemp("chain")
    make_workspace(folder)
    for command in COMMANDS:
        assert main([*arguments(command, folder), "-q"]) == 0, f"plop {command} failed"
    return folder
