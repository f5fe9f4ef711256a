"""Tracks belong to the Gaussians that they follow."""

import pytest
import torch

from plop.errors import PlopError
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import TrajectoryWriter
from plop.tracking.tracks import _paths


def row_of(count: int) -> Gaussians:
    means = torch.arange(3.0 * count).reshape(count, 3)
    quats = torch.tensor([1.0, 0, 0, 0]).repeat(count, 1)
    return Gaussians(
        means, quats, torch.ones(count, 3), torch.ones(count), torch.zeros(count, 1, 3), torch.arange(count)
    )


def test_a_track_of_another_fit_is_refused(tmp_path):
    with TrajectoryWriter(tmp_path / "a.h5") as writer:
        for frame in range(2):
            writer.append("updated", frame, row_of(6), side=torch.zeros(6))
    assert _paths(row_of(6), tmp_path / "a.h5", 2)[0].shape == (2, 6, 3)
    with pytest.raises(PlopError, match="Gaussians of the track are not") as caught:
        _paths(row_of(5), tmp_path / "a.h5", 2)
    assert "plop filter" in caught.value.fix
    with pytest.raises(PlopError, match="another recording"):
        _paths(row_of(6), tmp_path / "a.h5", 3)
