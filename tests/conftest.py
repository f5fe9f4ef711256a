"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

REPOSITORY = Path(__file__).resolve().parent.parent

# a machine that does something else as well is slow, which is no fault of the code
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Give the folder of real data that is not part of the project; skip where it is absent."""
    folder = Path(os.environ.get("PLOP_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the real data are not here ({folder}); set PLOP_SHARED_DATA to their folder")
    return folder
