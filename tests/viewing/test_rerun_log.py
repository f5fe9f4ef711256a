"""What goes to the viewer; the viewer itself is an optional package and is played by a list."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from plop.comparison.error_fields import error_field
from plop.comparison.field_file import stored_field, write_field
from plop.viewing.rerun_log import log_field
from tests.comparison.test_error_fields import episode  # noqa: F401
from tests.support.compare_scene import FRAMES


@pytest.fixture
def viewer():
    logged: list[tuple[str, object]] = []

    def made(*arguments, **named):
        return SimpleNamespace(arguments=arguments, **named)

    return SimpleNamespace(
        logged=logged,
        log=lambda entity, thing: logged.append((entity, thing)),
        set_time=lambda *a, **k: None,
        Points3D=made,
        Arrows3D=made,
        Scalars=made,
    )


def test_measured_predicted_and_error_of_every_frame(viewer, episode, tmp_path):  # noqa: F811
    shift = np.zeros_like(episode.points)
    shift[1:, :, 2] = -0.002
    write_field(tmp_path / "a.npz", stored_field(error_field(episode, episode.points + shift)))
    log_field(viewer, tmp_path / "a.npz")
    entities = [entity for entity, _ in viewer.logged]
    assert all(entities.count(f"world/{part}") == FRAMES for part in ("measured", "predicted", "error"))
    arrows = [thing for entity, thing in viewer.logged if entity == "world/error"]
    assert arrows[-1].vectors == pytest.approx(np.broadcast_to([0, 0, -0.002], arrows[-1].vectors.shape), abs=1e-6)
    errors = [thing.arguments[0] for entity, thing in viewer.logged if entity == "error_mm"]
    assert errors[0] == 0 and errors[-1] == pytest.approx(2, rel=1e-3)
