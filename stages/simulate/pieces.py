"""Stored results of a run's finished pieces, for resuming: the hidden effects, and their response."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

import numpy as np

from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType
from plop.physics.hidden.response import Response
from plop.physics.scenes.scene import Scene
from plop.physics.scenes.sealed import open_answer, seal_answer
from plop.pipeline.stage import Output
from plop.recordings.readers.mesh.sequence import MeshSequence


class Pieces:
    """Hidden files in the scratch folder; none of them becomes part of the artifact."""

    def __init__(self, out: Output, scene: Scene) -> None:
        self.out, self.scene = out, scene
        self.folder = out.path / ".checkpoints"
        self.response = Response(scene)

    @property
    def names(self) -> list[str]:
        """Names of all episodes."""
        return [self.scene.episode_name(k) for k in range(self.scene.episodes)]

    def hidden(self, known: dict[str, EffectType], choose: Callable[[], Sequence[Effect]]) -> list[Effect]:
        """Return the hidden effects: those of the interrupted run, or chosen now."""
        if self.out.is_done("hidden"):
            return [known[name](**values) for name, values in open_answer(self.folder)["effects"].items()]
        chosen = list(choose())
        seal_answer(self.folder, {"effects": {effect.name: dict(effect.values) for effect in chosen}})
        self.out.mark_done("hidden")
        return chosen

    def keep_response(self, k: int, sequence: MeshSequence, hidden: Sequence[Effect]) -> None:
        """Store the displacement caused by the hidden effects in episode k."""
        squares = self.response.squares(k, sequence.vertices, hidden) if hidden else (0.0, 1)
        self.folder.mkdir(exist_ok=True)
        (self.folder / f"response_{k:03d}.json").write_text(json.dumps(squares))

    def rms_m(self) -> float:
        """Root mean square of the displacement caused by the hidden effects, over surface, frames and episodes [m]."""
        kept = [json.loads((self.folder / f"response_{k:03d}.json").read_text()) for k in range(self.scene.episodes)]
        total, count = np.sum(kept, axis=0)
        return float(np.sqrt(total / count))
