"""One small set of inputs for all tests of the report."""

from __future__ import annotations

import pytest

from plop.pipeline.stage import Input
from tests.report.report_inputs import report_inputs


@pytest.fixture(scope="session")
def inputs(tmp_path_factory) -> dict[str, Input]:
    return report_inputs(tmp_path_factory.mktemp("report"))
