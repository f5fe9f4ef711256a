"""A tracked episode as a fit of the engine's material takes it: patches at the compared frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plop.comparison.discretisations import predicted_by_each
from plop.comparison.engine_run import predict_points, start_particles
from plop.diagnosis.evidence.evidence import compared_frames
from plop.physics.adapters.filled import EngineBase
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.tracking.episode import Episode


@dataclass(frozen=True)
class TrackedCase:
    """An episode as `calibrate` wants it.

    The prediction is the mean over discretisations, as `diagnose` takes it. A fit to one of them takes what its
    particles happen to do, whether a block slips on the table or under the tool, for the object's friction.
    """

    episode: Episode
    base: EngineBase

    @property
    def name(self) -> str:
        """Name of the episode."""
        return self.episode.name

    @property
    def table_z_m(self) -> float | None:
        """Height of the table [m]."""
        return self.episode.table_z_m

    @property
    def observed(self) -> np.ndarray:
        """Measured displacements of the patches, [F, K, 3] [m]; NaN where they could not be seen."""
        frames = compared_frames(len(self.episode.times))
        return np.where(self.episode.seen_patches[frames][..., None], self.episode.motion[frames], np.nan)

    def predict(self, material: Material, config: EngineConfig) -> np.ndarray:
        """Run the engine and give the same, [F, K, 3] [m]; the grid is the base's own, not `config`'s."""
        base = replace(self.base, material=material)
        return self.pooled(np.mean(predicted_by_each(base, self.episode), 0))

    def pooled(self, points: np.ndarray) -> np.ndarray:
        """Average displacements of the followed points [T, M, 3] over patches, [F, K, 3] [m]."""
        return self.episode.pooled((points - points[:1])[compared_frames(len(self.episode.times))])


class SlopeCase(TrackedCase):
    """The same in the one discretisation of its engine, which is enough for derivatives."""

    def predict(self, material: Material, config: EngineConfig) -> np.ndarray:
        """Run the engine and give displacements of the patches, [F, K, 3] [m]."""
        base = replace(self.base, material=material)
        return self.pooled(predict_points(base, self.episode, start_particles(base, self.episode)))


def mean_square(case: TrackedCase) -> float:
    """Mean squared distance of the patches to what the engine of a case predicts [m^2]."""
    error = case.predict(case.base.material, case.base.config) - case.observed
    return float(np.nanmean((error**2).sum(-1)))
