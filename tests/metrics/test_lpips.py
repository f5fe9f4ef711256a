"""LPIPS: the plain-torch stacks against torchmetrics' composition, with made-up backbone weights."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn
from torchmetrics.functional.image import lpips as oracle

from plop.errors import PlopError
from plop.metrics.lpips import BACKBONE_FILES, Unavailable, alexnet_features, load_lpips, vgg16_features

STACKS = {"alex": alexnet_features, "vgg": vgg16_features}


def made_up(net: str) -> nn.Sequential:
    """The same weights each time."""
    torch.manual_seed(0)
    stack, _ = STACKS[net]()
    for layer in stack:
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight)
    return stack


def write_backbone(folder: Path, net: str) -> Path:
    path = folder / BACKBONE_FILES[net]
    torch.save({f"features.{key}": value for key, value in made_up(net).state_dict().items()}, path)
    return path


@pytest.fixture
def images() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.random((70, 65, 3)), rng.random((70, 65, 3))


@pytest.mark.parametrize("net", ["alex", "vgg"])
def test_against_torchmetrics(net, tmp_path, images, monkeypatch):
    stack = made_up(net)
    path = write_backbone(tmp_path, net)
    monkeypatch.setattr(oracle, "_get_tv_model_features", lambda name, pretrained=False: stack)
    reference = oracle._LPIPS(pretrained=True, net=net, pnet_rand=True).eval()
    first, second = (torch.from_numpy(image).float().permute(2, 0, 1)[None] for image in images)
    expected = float(reference(first, second, normalize=True))
    score = load_lpips(net, str(path))
    assert score.score(*images) == pytest.approx(expected, rel=1e-4)
    assert score.score(images[0], images[0]) == 0


def test_small_crops_have_a_score(tmp_path, images):
    score = load_lpips("alex", str(write_backbone(tmp_path, "alex")))
    assert score.score(images[0][:12, :30], images[1][:12, :30]) > 0


def test_unavailable_without_the_backbone(tmp_path, monkeypatch):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    found = load_lpips("alex")
    assert isinstance(found, Unavailable)
    assert BACKBONE_FILES["alex"] in found.reason


def test_the_hub_folder_is_searched(tmp_path, monkeypatch, images):
    folder = tmp_path / "hub" / "checkpoints"
    folder.mkdir(parents=True)
    write_backbone(folder, "alex")
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    assert load_lpips("alex").score(*images) > 0


def test_a_named_file_that_is_missing_or_wrong_is_an_error(tmp_path):
    with pytest.raises(PlopError, match="no LPIPS backbone"):
        load_lpips("alex", str(tmp_path / "nowhere.pth"))
    wrong = tmp_path / "wrong.pth"
    for content, found in (
        (b"not weights", "not a file of tensors"),
        (b"", "empty"),
        (b"PK\x03\x04cut", "zip archive"),
    ):
        wrong.write_bytes(content)
        with pytest.raises(PlopError, match="cannot be loaded") as caught:
            load_lpips("alex", str(wrong))
        assert found in caught.value.found


def test_broken_head_weights_are_not_blamed_on_the_backbone(tmp_path, monkeypatch):
    write_backbone(tmp_path, "alex")
    heads = tmp_path / "heads.pth"
    heads.write_bytes(b"not weights")
    monkeypatch.setattr("plop.metrics.lpips._head_file", lambda backbone: heads)
    with pytest.raises(PlopError, match="cannot be loaded") as caught:
        load_lpips("alex", str(tmp_path / BACKBONE_FILES["alex"]))
    assert caught.value.where == str(heads)


def test_a_pickle_that_would_run_something_is_refused_without_running_it(tmp_path):
    class Harmful:
        def __reduce__(self):
            return Path.touch, (tmp_path / "ran",)

    torch.save({"features.0.weight": Harmful()}, tmp_path / "harmful.pth")
    with pytest.raises(PlopError, match="cannot be loaded") as caught:
        load_lpips("alex", str(tmp_path / "harmful.pth"))
    assert caught.value.found == "not a file of tensors" and not (tmp_path / "ran").exists()


def test_published_pair_is_ranked_as_people_do(shared_data):
    """Needs the real backbone in torch's hub folder, which is not part of the project."""
    score = load_lpips("alex")
    if isinstance(score, Unavailable):
        pytest.skip(score.reason)
    from PIL import Image

    names = ("ex_ref.png", "ex_p0.png", "ex_p1.png")
    folder = shared_data / "lpips_examples"
    reference, blurred, warped = (np.asarray(Image.open(folder / name).convert("RGB")) / 255 for name in names)
    assert score.score(warped, reference) < score.score(blurred, reference)
