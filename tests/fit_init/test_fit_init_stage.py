"""fit-init on a scene with a closed form: an ellipsoid on a table."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.pipeline.stage import Input, Output
from stages.fit_init.stage import STAGE, FitInitConfig
from stages.fit_init.tool_splats import drawn_in
from tests.support.ellipsoid_scene import CENTER, RADII, TOOL, ellipsoid_distance, ring, write_set

SMALL = FitInitConfig(count=500, steps=120, tool_count=60)


def fit(folder: Path, out: Path, config: FitInitConfig = SMALL, clouds: Path | None = None, progress=None):
    out.mkdir(exist_ok=True)
    inputs = {"recordings": Input(folder)}
    if clouds is not None:
        inputs["clouds"] = Input(clouds)
    return STAGE.run(inputs, config, Output(out) if progress is None else Output(out, progress))


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    write_set(folder / "set", {"a": {}}, cameras=ring(5, 64))
    summary = fit(folder / "set", folder / "out")
    return folder, summary


def test_a_view_that_was_not_fitted_is_rendered_well(fitted, tmp_path):
    folder, summary = fitted
    fit(folder / "set", tmp_path / "seeds", replace(SMALL, steps=0))
    for seed in (1, 2):
        fit(folder / "set", tmp_path / f"fit_{seed}", replace(SMALL, seed=seed))
    outs = folder / "out", tmp_path / "fit_1", tmp_path / "fit_2", tmp_path / "seeds"
    score, *others, seeds = (json.loads((out / "fit.json").read_text())["episodes"]["a"] for out in outs)
    assert len(score["held_out"]) == 1 and score["held_out"][0] not in score["views"]
    # The start, discs on the fused cloud, already has the depth: 120 steps win colour and may lose a little of it.
    assert score["psnr_db"] > seeds["psnr_db"] + 0.6, "the fit, not its start, did it"
    # one fit may lose two of the view's 320 object pixels more than another, by rounding: the mean of three is judged
    coverage = np.mean([s["coverage"] for s in (score, *others)])
    assert coverage > seeds["coverage"] - 0.01, "no hole where the fitted views saw the surface"
    assert score["depth_error_mm"] < 2.5  # 64 px, 120 steps
    assert summary.figures["psnr_db"] == pytest.approx(score["psnr_db"], abs=0.01)
    assert (folder / "out" / "a" / f"view_{score['held_out'][0]}.png").is_file()


def test_the_object_lies_where_the_ellipsoid_is_and_is_filled(fitted):
    folder, _ = fitted
    blob = read_splat(folder / "out" / "a" / "object.ply")
    distance = ellipsoid_distance(blob.means.numpy().astype(float))
    assert 400 < len(blob) <= SMALL.count
    assert np.percentile(distance, 99) < 0.004
    assert (distance < -0.008).sum() > 40, "Gaussians inside"
    generator = np.random.default_rng(0)
    inside = CENTER + 0.6 * RADII * generator.uniform(-1, 1, (500, 3)) / np.sqrt(3)
    gaps = torch.cdist(torch.from_numpy(inside).float(), blob.means).amin(1)
    assert gaps.max() < 0.02, "no hole inside"
    ratio = blob.scales.amax(1) / blob.scales.amin(1)
    assert ratio.max() < 1.3 * SMALL.anisotropy_ratio


def test_the_tool_is_sampled_in_its_own_frame(fitted):
    folder, _ = fitted
    tool = read_splat(folder / "out" / "a" / "tool.ply")
    assert len(tool) == SMALL.tool_count
    corners = drawn_in(TOOL, SMALL.tool_count).vertices[TOOL.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    beyond = np.einsum("nfk,fk->nf", tool.means.numpy()[:, None] - corners[:, 0], across)
    assert np.abs(beyond).min(1).max() < 1e-6, "each on a face"
    assert tool.means.min() > -5e-4 and tool.means.sum(1).max() < 0.0105


def test_the_same_seed_gives_the_same_bytes(fitted, tmp_path):
    folder, _ = fitted
    fit(folder / "set", tmp_path / "again")
    for name in ("object.ply", "tool.ply", "fit.json"):
        assert (tmp_path / "again" / "a" / name).read_bytes() == (folder / "out" / "a" / name).read_bytes()


class Killed(Exception):
    pass


def test_a_killed_run_keeps_its_finished_episodes(fitted, tmp_path):
    folder, _ = fitted
    quick = replace(SMALL, steps=20, jobs=1)
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring(4, 48))

    def stop(done, total, label="", **figures):
        if label == "b":
            raise Killed

    with pytest.raises(Killed):
        fit(tmp_path / "set", tmp_path / "out", quick, progress=stop)
    first = tmp_path / "out" / "a" / "object.ply"
    before = first.stat().st_mtime_ns
    assert not (tmp_path / "out" / "fit.json").exists()
    seen = []
    fit(tmp_path / "set", tmp_path / "out", quick, progress=lambda done, total, label="", **f: seen.append(label))
    assert first.stat().st_mtime_ns == before and "b" in seen
    fit(tmp_path / "set", tmp_path / "whole", quick)
    for name in ("a", "b"):
        paths = [tmp_path / run / name / "object.ply" for run in ("out", "whole")]
        assert paths[0].read_bytes() == paths[1].read_bytes()


@pytest.mark.parametrize(("filling", "inner"), [("none", 0), ("paper", None)])
def test_other_fillings(fitted, tmp_path, filling, inner):
    folder, _ = fitted
    fit(folder / "set", tmp_path / "out", replace(SMALL, steps=20, filling=filling))
    score = json.loads((tmp_path / "out" / "a" / "fit.json").read_text())
    if inner is None:
        assert score["inner"] > 50
    else:
        assert score["inner"] == inner


def test_a_fused_cloud_starts_the_fit(fitted, tmp_path):
    from stages.fuse.stage import STAGE as FUSE
    from stages.fuse.stage import FuseConfig

    folder, _ = fitted
    (tmp_path / "fuse").mkdir()
    FUSE.run({"recordings": Input(folder / "set")}, FuseConfig(), Output(tmp_path / "fuse"))
    fit(folder / "set", tmp_path / "out", replace(SMALL, steps=60), clouds=tmp_path / "fuse")
    score = json.loads((tmp_path / "out" / "a" / "fit.json").read_text())
    assert score["psnr_db"] > 19


def damage(folder: Path, key: str, change, only: str | None = None, name: str = "a") -> None:
    with h5py.File(folder / "episodes" / f"{name}.h5", "r+") as file:
        for camera in file["cameras"]:
            if only in (None, camera):
                data = file[f"cameras/{camera}/{key}"]
                data[...] = change(data[:])


@pytest.mark.parametrize(
    ("key", "change", "message"),
    [
        ("mask", np.zeros_like, "No camera sees the object"),
        ("depth_m", np.zeros_like, "No camera measured the depth"),
        ("depth_m", lambda depth: np.full_like(depth, np.nan), "No camera measured the depth"),
        ("depth_m", lambda depth: depth * 1000, "cannot be in metres"),
    ],
)
def test_bad_images_are_explained(tmp_path, key, change, message):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3, 48))
    damage(tmp_path / "set", key, change)
    with pytest.raises(PlopError, match=message) as error:
        fit(tmp_path / "set", tmp_path / "out")
    assert error.value.fix
    assert not (tmp_path / "out" / "fit.json").exists()


def test_a_bad_episode_does_not_stop_the_others(tmp_path):
    write_set(tmp_path / "set", {"a": {}, "b": {}}, cameras=ring(4, 48))
    damage(tmp_path / "set", "mask", np.zeros_like)
    summary = fit(tmp_path / "set", tmp_path / "out", replace(SMALL, steps=10))
    facts = json.loads((tmp_path / "out" / "fit.json").read_text())
    assert list(facts["episodes"]) == ["b"] and "No camera sees" in facts["skipped"]["a"]
    assert any("a was skipped" in warning for warning in summary.warnings)


def test_a_blind_camera_is_a_warning_and_two_cameras_hold_none_out(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(3, 48))
    damage(tmp_path / "set", "mask", np.zeros_like, only="cam1")
    summary = fit(tmp_path / "set", tmp_path / "out", replace(SMALL, steps=10))
    assert any("cam1 does not see" in warning for warning in summary.warnings)
    assert any("none is held out" in warning for warning in summary.warnings)


def test_more_cameras_than_there_are_to_spare_cannot_be_held_out(tmp_path):
    write_set(tmp_path / "set", {"a": {}}, cameras=ring(4, 32))
    with pytest.raises(PlopError, match="Too many cameras are held out") as caught:
        fit(tmp_path / "set", tmp_path / "out", replace(SMALL, steps=0, held_out=9))
    assert "0 to 2: of 4 cameras" in str(caught.value.expected) and caught.value.found == "held_out = 9"
    damage(tmp_path / "set", "mask", np.zeros_like, only="cam3")
    summary = fit(tmp_path / "set", tmp_path / "less", replace(SMALL, steps=0, held_out=2))
    assert any("3 cameras see the object: 1 of 2 are held out" in warning for warning in summary.warnings)


def test_a_missing_or_broken_cloud_is_explained(fitted, tmp_path):
    folder, _ = fitted
    (tmp_path / "clouds").mkdir()
    with pytest.raises(PlopError, match="no such PLY"):
        fit(folder / "set", tmp_path / "out", clouds=tmp_path)
    (tmp_path / "clouds" / "a.ply").write_bytes(
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"
    )
    with pytest.raises(PlopError, match="lacks properties"):
        fit(folder / "set", tmp_path / "out", clouds=tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"filling": "foam"},
        {"count": 0},
        {"background": "sky"},
        {"sh_degree": 4},
        {"episodes": "z*"},
        {"inner_share": 1.0},
    ],
)
def test_bad_settings_are_explained(fitted, tmp_path, wrong):
    folder, _ = fitted
    with pytest.raises(PlopError):
        fit(folder / "set", tmp_path / "out", replace(SMALL, **wrong))
