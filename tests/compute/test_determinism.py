"""Deterministic algorithms are switched on for a block, at no cost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import torch

from plop.compute.determinism import deterministic

ROOT = Path(__file__).resolve().parents[2]


def test_the_switch_is_put_back():
    before = torch.are_deterministic_algorithms_enabled()
    with deterministic():
        assert torch.are_deterministic_algorithms_enabled() and torch.is_deterministic_algorithms_warn_only_enabled()
        with deterministic():
            pass
        assert torch.are_deterministic_algorithms_enabled()
    assert torch.are_deterministic_algorithms_enabled() == before


CODE = """
import sys
from plop.compute.determinism import deterministic
with deterministic():
    print('torch._dynamo' in sys.modules)
"""


def test_the_compiler_of_torch_is_not_loaded():
    said = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert said.strip() == "False"
