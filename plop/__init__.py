"""plop: from recordings of a robot cutting a soft object to a learned, scored dynamics model.

`import plop` is all that a notebook or a planner needs; docs/how-to/python.md shows how to use the names. A name is
imported when it is first used, so that `import plop` itself loads nothing heavy.
"""

from __future__ import annotations

import importlib
from typing import Any

from plop.compute.waiting import wait_briefly

wait_briefly()

_PUBLIC = {
    # the workspace and its stages
    "Store": "plop.artifacts.store",
    "Artifact": "plop.artifacts.store",
    "run": "plop.pipeline.run",
    "PlopError": "plop.errors",
    # what was recorded
    "Recording": "plop.recordings.recording",
    "RecordingSet": "plop.recordings.set",
    "Camera": "plop.geometry.cameras",
    # Gaussians and pictures of them
    "Gaussians": "plop.gaussians.state",
    "read_splat": "plop.gaussians.splat_ply",
    "render_scene": "plop.render.scene",
    # models, one step or many
    "load_model": "plop.models",
    "DynamicsModel": "plop.dynamics.interface",
    "InitialScene": "plop.dynamics.initial_scene",
    "ParticleState": "plop.dynamics.interface",
    "ToolStep": "plop.dynamics.interface",
    "rollout": "plop.dynamics.rollout",
    "Band": "plop.uncertainty.band",
    "ensemble_spread": "plop.uncertainty.spread",
    "compare": "plop.comparison.rollout_errors",
    "FrameErrors": "plop.comparison.rollout_errors",
    # the engine, and the laws that a model may be missing
    "Scene": "plop.physics.scenes.scene",
    "Material": "plop.physics.engine.material",
    "simulate": "plop.physics.scenes.scene:simulate_episode",
    "Effect": "plop.physics.effects.effect",
    "Parameter": "plop.parameters",
    "Estimate": "plop.parameters",
    "effect_type": "plop.physics.effects.library",
    "augment": "plop.models",
    "diagnose": "plop.pipeline.diagnose",
    "Verdict": "plop.diagnosis.decision.verdict",
}
"""Public name -> module that holds it, `module:name` where its name there differs."""

__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("plop")
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, inner = _PUBLIC[name].partition(":")
    found = getattr(importlib.import_module(module), inner or name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
