"""The step of profile `paper` that is measured renders all views, and merges and splits."""

from __future__ import annotations

import json

import pytest
import torch

from benchmarks.speed import paper


@pytest.mark.parametrize(
    "device",
    ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA"))],
)
def test_a_step_is_measured(device, tmp_path, monkeypatch, capsys):
    arguments = ["--device", device, "--gaussians", "300", "--repeats", "1", "--out", str(tmp_path / "step.json")]
    monkeypatch.setattr("sys.argv", ["paper", *arguments])
    assert paper.main() == 0
    found = json.loads((tmp_path / "step.json").read_text())[device]["gaussians"]["300"]
    assert found["without_images"]["step_s"] > 0 and found["without_images"]["peak_mb"] > 1
    assert found["without_images"]["splits"] == 0
    if "unavailable" not in found["whole"]:
        assert found["whole"]["splits"] > 0 and found["whole"]["step_s"] > 0
