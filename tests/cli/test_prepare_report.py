"""What a report calls its models."""

from __future__ import annotations

import pytest

from plop_cli.prepare_report import labels_of_models


@pytest.mark.parametrize(("typed", "labels"), [
    ("base, base+tilt", ("base", "base+tilt")), ("base", ("base",)), ("train@1234,base", ()), ("base,base", ()),
])  # fmt: skip
def test_models_are_called_as_the_user_typed_them(typed: str, labels: tuple[str, ...]):
    assert labels_of_models(typed) == labels
