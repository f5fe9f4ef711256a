"""PLOP_PLAIN_THREADS=1: threads, memory and compiled code are left alone, and the numbers are the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from plop.compute.plain import PLAIN
from plop.compute.waiting import POLICY

ROOT = Path(__file__).resolve().parents[2]
RUN = """
import hashlib, json, os, threading
import numpy as np
import plop, torch
from plop.compute.malloc import keep_freed_memory
keep_freed_memory()  # as every command does
from plop.compute.determinism import deterministic
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.interface import ToolStep, at_rest
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.kernels.transfer import g2p
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.render.rasterizer.numba_blend import blend_forward
from plop.render.rasterizer.rasterize import render
from tests.dynamics.conftest import blade, pose
from tests.support.small_episode import cameras, coloured_block

torch.set_num_threads(2)
os.getloadavg = lambda: (0.0, 0.0, 0.0)  # else a busy machine gets one thread

def digest(*arrays):
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()

axes = [(np.arange(n) + 0.5) * 0.005 for n in (6, 5, 4)]
places = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
law = library()["stiffening"](growth=50.0)
run = simulate(
    Particles(places, np.full(len(places), 1.25e-7)), Material(), None, np.linspace(0, 0.02, 3),
    EngineConfig(dx_m=0.01, threads=2), effects=[law],
)

torch.manual_seed(0)
model, block = PlopModel(PlopConfig(tool_points=50, stray_m=1e-5, cut_faces=True)), coloured_block(300)
torch.nn.init.normal_(model.network.decode[-1].weight, std=0.3)
optimiser = torch.optim.AdamW(model.parameters())
with deterministic():
    for _ in range(2):
        optimiser.zero_grad()
        action = ToolStep(blade(), pose(0.03, 0.02, 0.015), pose(0.032, 0.02, 0.01), 0.04, 0.0)
        state = model.step(at_rest(block), action)
        picture = render(state.gaussians, cameras()[0])
        (picture.rgb.square().mean() + picture.depth_m.mean()).backward()
        optimiser.step()
weights = [p.detach().numpy() for p in model.parameters()]
names = [t.name for t in threading.enumerate()]
print(json.dumps({
    "engine": digest(run.positions, run.F),
    "picture": digest(picture.rgb.detach().numpy()),
    "weights": digest(*weights),
    "cached": [type(f._cache).__name__ != "NullCache" for f in (g2p, blend_forward)],
    "pools": sum(name.startswith("kernels") for name in names),
    "environment": sorted(n for n in os.environ if n.startswith("MALLOC_") or n in {policy}),
}))
"""


def run(**environment: str) -> dict:
    clean = {k: v for k, v in os.environ.items() if k not in POLICY and not k.startswith("MALLOC_") and k != PLAIN}
    extra = {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "2"} | environment
    done = subprocess.run(
        [sys.executable, "-c", RUN.replace("{policy}", repr(POLICY))],
        env=clean | extra,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's and GNU OpenMP's settings")
def test_both_ways_agree_and_the_plain_one_touches_nothing():
    tuned, plain = run(), run(**{PLAIN: "1"})
    for what in ("engine", "picture", "weights"):
        assert tuned[what] == plain[what], what
    assert len(tuned["environment"]) == 4 and tuned["pools"] > 0
    assert plain["environment"] == [] and plain["pools"] == 0
    assert all(tuned["cached"]) and not any(plain["cached"])
