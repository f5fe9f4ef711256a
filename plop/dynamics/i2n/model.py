"""The PLOP model: I2N predicts motion and opacity, then Gaussians merge and split (PLOP, Eq. 13, 26)."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from plop.dynamics.cohesion import held_together
from plop.dynamics.cut import advance_sides, narrowed_at_cut
from plop.dynamics.i2n.features import mirrored_in_table, object_features, rigid_displacement, tool_features
from plop.dynamics.i2n.network import I2N, I2NConfig, ParticleBatch
from plop.dynamics.i2n.tool_frame import StepFrame, tool_frame, world_frame
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep
from plop.dynamics.resampling import ResamplingConfig, resample
from plop.geometry.rigid import quat_from_rotation_vector, quat_multiply

ROTATION_UNIT_RAD = 0.1
LOG_SCALE_UNIT = 0.02
LOGIT_UNIT = 0.1


@dataclass(frozen=True)
class PlopConfig:
    """The model's configuration and the units of its inputs and outputs."""

    network: I2NConfig = field(default_factory=I2NConfig)
    resampling: ResamplingConfig = field(default_factory=ResamplingConfig)
    frame: str = "tool"
    """"tool" (turns with the tool about the vertical) or "world" (the paper's form)."""
    coupled: bool = True
    """A particle also follows a learned share of the tool's motion at its position; off in the paper."""
    length_m: float = 0.1
    """Longest extent of the object, from the training set [m]."""
    motion_m: float = 1e-3
    """Typical motion in a step, from the training set [m]."""
    tool_points: int = 600
    """Particles that represent the tool."""
    stray_m: float | None = None
    """Largest distance of a Gaussian from the position predicted by its neighbours, from the training set [m];
    None: no limit, as in the paper."""
    cut_faces: bool = False
    """A Gaussian that a blade passes becomes so narrow that it does not reach across the cut; off in the paper."""


class PlopModel(nn.Module, DynamicsModel):
    """Dynamics D_theta and resampling R_psi."""

    kind = "plop"
    """Name of the dynamics in model files."""

    def __init__(self, config: PlopConfig) -> None:
        super().__init__()
        self.config = config
        self.network = I2N(config.network)

    @property
    def spacing_m(self) -> float:
        """Grid spacing h [m]."""
        return self.config.length_m / self.config.network.cells_across

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        """Advance one frame: predict, update opacity, limit outliers, merge, split."""
        return resample(self.move(state, action), self.config.resampling, generator=generator)

    def move(self, state: ParticleState, action: ToolStep) -> ParticleState:
        """Advance one frame without merging and splitting."""
        moved = held_together(state, self.predict([state], [action])[0], self.config.stray_m)
        return narrowed_at_cut(state.side, moved, action) if self.config.cut_faces else moved

    def predict(
        self, states: list[ParticleState], actions: list[ToolStep], frames: list[StepFrame] | None = None
    ) -> list[ParticleState]:
        """Predict motion and opacity of several steps at once, without merging and splitting.

        Args:
            states: B states.
            actions: B actions.
            frames: Frames of the network's input; the configured ones when absent.

        Returns:
            B predicted states.
        """
        frames = frames or [self.frame(action) for action in actions]
        units = {"motion_m": self.config.motion_m}
        parts, tools, with_tool = [], [], []
        for b, (state, action, frame) in enumerate(zip(states, actions, frames, strict=True)):
            means = state.gaussians.means
            with_tool.append(rigid_displacement(means, action))
            place = frame.points_in(means)
            features = object_features(
                state,
                action,
                frame,
                with_tool[b],
                place,
                length_m=self.config.length_m,
                kind=self.config.network.features,
                **units,
            )
            parts.append(ParticleBatch(place, features, _filled(means, b)))
            pose = action.world_from_tool.to(means)
            points = action.tool.surface_points(self.config.tool_points).to(means) @ pose[:3, :3].T + pose[:3, 3]
            features = tool_features(points, action, frame, **units)
            tools.append(ParticleBatch(frame.points_in(points), features, _filled(points, b)))
        raw = self.network(_join(parts), _join(tools), len(states), self.spacing_m)
        pieces = raw.split([len(state.gaussians) for state in states])
        return [self._advance(*item) for item in zip(states, actions, frames, with_tool, pieces, strict=True)]

    def frame(self, action: ToolStep) -> StepFrame:
        """Return the frame of the network's input for a step."""
        return tool_frame(action) if self.config.frame == "tool" else world_frame(action)

    def _advance(
        self, state: ParticleState, action: ToolStep, frame: StepFrame, with_tool: Tensor, raw: Tensor
    ) -> ParticleState:
        gaussians = state.gaussians
        out = frame.rotation.T
        shift = raw[:, 0:3] @ (out * self.config.motion_m)
        if self.config.coupled:
            # Pushed material moves with the tool: a share is easier to learn than a motion.
            tool_motion = with_tool.detach()
            shift = shift + raw[:, 10:11] * tool_motion
            if self.config.network.features == "oriented":
                shift = shift + raw[:, 11:12] * mirrored_in_table(tool_motion)
        turn = raw[:, 3:6] @ (out * (frame.handedness * ROTATION_UNIT_RAD))
        means = gaussians.means + shift
        logit = torch.logit(gaussians.opacities.clamp(1e-4, 1 - 1e-4)) + raw[:, 9] * LOGIT_UNIT
        moved = gaussians.with_(
            means=means,
            quats=nn.functional.normalize(quat_multiply(quat_from_rotation_vector(turn), gaussians.quats), dim=-1),
            scales=gaussians.scales * (LOG_SCALE_UNIT * raw[:, 6:9]).clamp(-0.2, 0.2).exp(),
            opacities=torch.sigmoid(logit),
        )
        side = advance_sides(state.side, means, action)
        return ParticleState(moved, shift, turn, side, has_history=True, rest=state.rest)


def _filled(points: Tensor, value: int) -> Tensor:
    return torch.full((len(points),), value, dtype=torch.int64, device=points.device)


def _join(parts: list[ParticleBatch]) -> ParticleBatch:
    return ParticleBatch(
        torch.cat([p.positions for p in parts]),
        torch.cat([p.features for p in parts]),
        torch.cat([p.batch for p in parts]),
    )
