"""One workspace in which every stage has run."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from filelock import FileLock

from plop_cli.app import main
from tests.pipeline.small_set import COMMANDS, arguments, make_workspace


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the workspace; nobody changes it. The processes of one test run share it: the first one makes it."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder, made = base / "chain", base / "chain.made"
    with FileLock(base / "chain.lock"):
        if not made.is_file():
            shutil.rmtree(folder, ignore_errors=True)  # of a process that failed
            folder.mkdir()
            make_workspace(folder)
            for command in COMMANDS:
                assert main([*arguments(command, folder), "-q"]) == 0, f"plop {command} failed"
            made.touch()
    return folder
