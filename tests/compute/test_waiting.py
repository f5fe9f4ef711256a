"""OpenMP threads spin briefly while they wait: set before torch is loaded, in every entry point and worker."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from plop.compute.waiting import POLICY

REPOSITORY = Path(__file__).resolve().parents[2]
BLAS = "OPENBLAS_NUM_THREADS"
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
    clean = {key: value for key, value in os.environ.items() if key not in (*POLICY, BLAS, "OMP_NUM_THREADS")}
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


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts threads as Linux lists them")
@pytest.mark.parametrize(("given", "threads"), [({}, 1), ({"PLOP_PLAIN_THREADS": "1"}, 1), ({BLAS: "2"}, 2)])
def test_numpy_multiplies_on_one_thread(given: dict[str, str], threads: int):
    """The threads are counted, so that it is seen when numpy's BLAS reads another variable."""
    if threads > (os.cpu_count() or 1):
        pytest.skip("needs two cores")
    product = "import plop, numpy as np, os; np.ones((400, 400)) @ np.ones((400, 400)); "
    assert int(run(product + "print(len(os.listdir('/proc/self/task')))", **given)) == threads
