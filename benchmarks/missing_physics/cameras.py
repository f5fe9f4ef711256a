"""Missing physics through cameras: what a user types.

`plop simulate` hides something and films it with six depth cameras, or another simulator's meshes are filmed by `plop
ingest mesh`; `plop diagnose` fits Gaussians, follows them and judges, against an engine that `plop identify` fitted to
recordings in which nothing is hidden; where plop simulates, in another discretisation and with another elastic law.
The engine is as fine as `identify` makes it by itself. The answer is opened only after the verdict.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from benchmarks.missing_physics.filmed import Filmed, Meshes, Simulated
from benchmarks.missing_physics.plan import CAMERAS, Set
from benchmarks.missing_physics.points import LEAST_SNR
from benchmarks.workspace import Typed
from plop.physics.effects.library import library
from stages.diagnose.stage import STAGE

SETTINGS = """\
[simulate]
episodes = 6                         # each kind of motion twice: an episode is predicted from the others
motions = ["push", "hold", "cut-push"]

[simulate.cameras]
texture = "dough"
depth_noise_m = 0.0005

[ingest.mesh.cameras]
texture = "dough"
depth_noise_m = 0.0005

[fit-init]
steps = 500
virtual_views = 0
count = 2400
tool_count = 2000

[filter.update]
iterations = 24

[identify]
iterations = 5
"""


class Cameras:
    """One workspace for each base."""

    def __init__(self, work: Path) -> None:
        self.work = work

    def row(self, one: Set) -> dict[str, Any]:
        """Hide, film, judge, and only then compare."""
        started, loop = time.process_time(), workspace(self.work / f"{one.world}-{one.seed}")
        filmed: Filmed = Simulated(loop, one) if one.world == CAMERAS else Meshes(loop, one)
        filmed.plain()
        loop.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base")
        if not filmed.hidden():
            verdict: dict[str, Any] = {"kind": "-", "named": [], "evidence": {}}
            return {**one._asdict(), "group": "unreachable", "said": {"reference": {"verdict": verdict}}, "snr": 0.0}
        left_out = [law for law in library() if one.group == "outside" and law != one.law]
        kept = [word for law in left_out for word in ("--effects", law)]
        loop.plop("diagnose", "--model", "base", "--recordings", one.name, "--name", f"verdict-{one.name}", *kept)
        found = json.loads((loop.store.find(f"verdict-{one.name}").path / "diagnosis.json").read_text())
        said = {key: found[key] for key in ("verdict", "searches", "error", "floor")}
        answer = filmed.answer()
        weak = one.group in ("single", "pair", "outside") and answer["snr"] < LEAST_SNR
        return {
            **one._asdict(),
            "group": f"{one.group} below" if weak else one.group,
            "said": {"reference": {**said, "ranking": found["ranking"][:3]}},
            "truth": answer["effects"],
            "snr": answer["snr"],
            "judged_by": STAGE.version,
            "cpu_s": round(time.process_time() - started, 1),
        }


def workspace(folder: Path) -> Typed:
    """Make a workspace."""
    return Typed(folder, SETTINGS)
