"""The surface of the first frame: Gaussians give the shape, depth the place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from plop.dynamics.initial_surface import LEAST_POINTS, FirstFrame, initial_surface
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.recordings.recording import Recording
from tests.support.coarse_episodes import gaussians
from tests.support.tracked_set import write_recordings

SIZE_M = [0.06, 0.05, 0.04]


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """Write one recording; give it and Gaussians on its surface."""
    inputs = write_recordings(tmp_path_factory.mktemp("set"), 1)
    path = next((inputs["recordings"].path / "episodes").glob("*.h5"))
    with Recording(path) as recording:
        yield recording, read_splat(inputs["init"].path / path.stem / "object.ply")


def drawn_in(fitted: Gaussians, by_m: float) -> Gaussians:
    """Move Gaussians towards the middle, by the same way on each side."""
    middle = torch.tensor([0.0, 0.0, 0.02])
    half = torch.tensor(SIZE_M) / 2
    return fitted.with_(means=middle + (fitted.means - middle) * (1 - by_m / half))


@pytest.mark.parametrize("by_m", [0.0, 0.0007])
def test_gaussians_beside_the_surface_give_it_all_the_same(episode, by_m):
    recording, fitted = episode
    found = initial_surface(recording, drawn_in(fitted, by_m))
    assert found is not None
    np.testing.assert_allclose(np.ptp(found[0], axis=0), SIZE_M, atol=6e-4)


def test_only_opaque_gaussians_on_the_surface_are_shown(episode):
    recording, fitted = episode
    faint = fitted.opacities.clone()
    faint[:100] = 0.2
    means = fitted.means.clone()
    means[100:150] = torch.tensor([0.0, 0.0, 0.02])
    shown = FirstFrame.of(recording).shown(fitted.with_(opacities=faint, means=means))
    assert not shown[:150].any() and shown[150:].mean() > 0.9


def test_with_too_little_there_is_no_surface(episode):
    recording, fitted = episode
    assert initial_surface(recording, fitted.select(torch.arange(LEAST_POINTS - 1))) is None
    assert initial_surface(recording, gaussians(np.zeros((60, 3)) + [0.0, 0.0, 0.02])) is None


def test_gaussians_in_one_plane_enclose_nothing(episode):
    recording, fitted = episode
    on_top = fitted.select(torch.nonzero(fitted.means[:, 2] > 0.0395).squeeze(1))
    flat = on_top.with_(means=on_top.means * torch.tensor([1.0, 1.0, 0.0]) + torch.tensor([0.0, 0.0, 0.04]))
    frame = replace(FirstFrame.of(recording), table_z_m=None)
    with pytest.raises(PlopError, match="enclose no volume"):
        frame.surface(flat.means.double().numpy())


def test_of_many_measured_points_some_are_enough(episode):
    recording, fitted = episode
    frame = FirstFrame.of(recording)
    places = fitted.means.double().numpy()[frame.shown(fitted)]
    many = replace(frame, points=np.repeat(frame.points, 1 + 100_000 // len(frame.points), axis=0))
    np.testing.assert_allclose(
        np.ptp(many.surface(places)[0], axis=0), np.ptp(frame.surface(places)[0], axis=0), atol=2e-4
    )


def test_a_frame_that_shows_no_object_is_an_error(episode, monkeypatch):
    recording, fitted = episode
    read = recording.view

    def blind(name, frame):
        view = read(name, frame)
        return type(view)(view.camera, view.rgb, np.zeros_like(view.depth_m), view.mask)

    monkeypatch.setattr(recording, "view", blind)
    with pytest.raises(PlopError, match="shows no object"):
        FirstFrame.of(recording)
    assert initial_surface(recording, fitted) is None
