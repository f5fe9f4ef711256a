"""OpenMP threads spin briefly while they wait: set before torch is loaded, in every entry point and worker."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from plop.compute.waiting import POLICY

REPOSITORY = Path(__file__).resolve().parents[2]
SEEN = f"import os, sys; print(*[os.environ.get(n, '-') for n in {POLICY}])"
HOOK = """
import sys, os
class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            print("TORCH AFTER", os.environ.get("GOMP_SPINCOUNT"), flush=True)
sys.meta_path.insert(0, Watch())
"""


def run(code: str, **environment: str) -> str:
    clean = {key: value for key, value in os.environ.items() if key not in POLICY}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=REPOSITORY,
        check=True,
        env=clean | environment,
    )
    return done.stdout


@pytest.mark.parametrize(
    "entry",
    [
        "import stages.train.stage",
        "import benchmarks.speed.dynamics",
        "from plop_cli.app import main; main(['train', '--help'])",
    ],
)
def test_it_is_set_before_torch_is_imported(entry: str):
    told = [line for line in run(HOOK + entry).splitlines() if line.startswith("TORCH AFTER")]
    assert told and set(told) == {"TORCH AFTER 1000"}


def test_workers_inherit_it():
    code = (
        "import plop; from joblib import Parallel, delayed; import os\n"
        "print(Parallel(2)(delayed(os.getenv)('GOMP_SPINCOUNT') for _ in range(2)))"
    )
    assert "['1000', '1000']" in run(code)


def test_what_the_user_has_set_stays():
    assert run("import plop; " + SEEN).split() == ["-", "1000", "1"]
    assert run("import plop; " + SEEN, OMP_WAIT_POLICY="ACTIVE").split() == ["ACTIVE", "-", "-"]
    assert run("import plop; " + SEEN, GOMP_SPINCOUNT="7").split() == ["-", "7", "-"]
