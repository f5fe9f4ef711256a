"""Fit one episode: from the views of frame 0 to the Gaussians of object and tool."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from plop.compute.device import chosen_device
from plop.errors import PlopError, remembering
from plop.gaussians.state import Gaussians, concatenate
from plop.geometry.view import View
from plop.recordings.recording import Recording
from plop.render.losses import target_from_view, target_over_measured
from stages.fit_init.held_out import check_held_out, choose_held_out, score_view
from stages.fit_init.inside import paper_filler, solid_filler, typical_spacing
from stages.fit_init.optimise import Fill, Report, fit
from stages.fit_init.shell import Surface, seed_gaussians, seen_by, surface_from_cloud, surface_from_views
from stages.fit_init.tool_splats import ToolViews, same_tool, spread_over, tool_gaussians
from stages.fit_init.virtual_views import virtual_views

if TYPE_CHECKING:
    from stages.fit_init.stage import FitInitConfig

EXTENT_M = (0.002, 3.0)
"""Plausible longest side of an object; outside, the unit of length is probably not the metre."""
_SCAN_VIEWS = 12
_SEEN_SHARE = 0.02
_LEAST_POINTS = 16
_LEAST_PIXELS = 16
_PAPER_CELLS = 16
_SEED_OPACITY = 0.9


@dataclass(frozen=True)
class EpisodeFit:
    """Result of one episode."""

    gaussians: Gaussians
    """The object, world frame; ids count from 0."""
    tool: Gaussians
    """The tool, in its own frame."""
    score: dict[str, Any]
    """Figures of the fit, JSON types only."""
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    """Measured | predicted | difference of the scored views, uint8, by name."""


def fit_episode(
    recording: Recording, training_episode: Recording | None, cloud: Path | None, config: FitInitConfig, report: Report
) -> EpisodeFit:
    """Fit object and tool.

    Args:
        recording: The episode.
        training_episode: Episode whose later frames may also be used: itself, or another one with the same tool.
        cloud: Cloud to start from; depth images when absent.
        config: Settings.
        report: Called with the progress.

    Raises:
        PlopError: Too few cameras for `held_out`, no camera sees the object, its surface was not measured, or its size
            cannot be in metres. It has the warnings collected before.
    """
    warnings: list[str] = []
    with remembering(warnings):
        return _fitted(recording, training_episode, cloud, config, report, warnings)


def _fitted(
    recording: Recording,
    training_episode: Recording | None,
    cloud: Path | None,
    config: FitInitConfig,
    report: Report,
    warnings: list[str],
) -> EpisodeFit:
    check_held_out(config.held_out, len(recording.camera_names), f"{recording.path}:/cameras")
    views = usable_views(recording, warnings)
    training, held = choose_held_out(views, config.held_out)
    if config.held_out and not held:
        warnings.append(f"{len(views)} cameras see the object: none is held out, the score is of a fitted view")
    elif len(held) < config.held_out:
        warnings.append(f"{len(views)} cameras see the object: {len(held)} of {config.held_out} are held out")
    training += _scan_views(recording)
    surface = _surface(recording, cloud, training)
    scene: dict[str, float] = {}
    if config.scene_size > 0:
        scene["scene_scale"] = scene_scale(surface.points, config.scene_size)
        config = replace(config, render=config.render.in_scene_units(scene["scene_scale"]))
    shell, inner = fit_object(surface, training, recording.table_z_m, config, report)
    gaussians = concatenate([shell, inner])
    gaussians = gaussians.with_(ids=torch.arange(len(gaussians)))
    tool, tool_seen = tool_gaussians(
        recording.tool_mesh, _tool_views(recording, training_episode, training), config.tool_count, config.seed
    )
    if tool_seen == 0:
        warnings.append("no camera shows the tool: its Gaussians are grey")
    if config.filling != "none" and len(inner) == 0:
        warnings.append("the shell encloses no volume: the inside is empty")
    scores = {view.camera.name: score_view(gaussians, view) for view in held or views[-1:]}
    depths = [score.depth_error_mm for score, _ in scores.values() if score.depth_error_mm is not None]
    facts = {
        "gaussians": len(gaussians),
        "inner": len(inner),
        "views": [view.camera.name for view in training],
        "held_out": [view.camera.name for view in held],
        "psnr_db": round(float(np.mean([score.psnr_db for score, _ in scores.values()])), 3),
        "psnr_black_db": round(float(np.mean([score.psnr_black_db for score, _ in scores.values()])), 3),
        "depth_error_mm": round(float(np.mean(depths)), 4) if depths else None,
        "coverage": round(float(np.mean([score.coverage for score, _ in scores.values()])), 4),
        "tool_gaussians": len(tool),
        "tool_seen": round(tool_seen, 3),
        "warnings": warnings,
        **scene,
    }
    pictures = {f"view_{name}": picture for name, (_, picture) in scores.items()}
    return EpisodeFit(gaussians, tool, facts, pictures)


def scene_scale(points: np.ndarray, size: float) -> float:
    """Return the scene units per metre for which the longest side of a cloud, [N, 3] [m], is `size` of them."""
    return size / float(np.ptp(points, axis=0).max())


def _tool_views(recording: Recording, training_episode: Recording | None, training: list[View]) -> list[ToolViews]:
    """Choose the images for the tool's colour: frame 0, and frames of a training episode with the same tool."""
    cameras = [view.camera.name for view in training if view.camera.name in recording.camera_names]
    if training_episode is recording:
        return [spread_over(recording, cameras)]
    views = [ToolViews(recording, cameras, [0])]
    if training_episode is not None and same_tool(recording.tool_mesh, training_episode.tool_mesh):
        views.append(spread_over(training_episode, [name for name in training_episode.camera_names if name in cameras]))
    return views


def fit_object(
    surface: Surface, views: list[View], table_z_m: float | None, config: FitInitConfig, report: Report | None = None
) -> tuple[Gaussians, Gaussians]:
    """Fit the object's shell and inside to views of one frame.

    Args:
        surface: Measured points, at least a few.
        views: Training views.
        table_z_m: Height of a table under the object [m].
        config: Settings.
        report: Called with the progress.

    Returns:
        Shell and inner Gaussians.
    """
    inner_count = int(config.inner_share * config.count) if config.filling == "solid" else 0
    shell_count = config.count - inner_count
    start = shell_count if config.densifications <= 0 else int(config.start_share * shell_count)
    seeds = seed_gaussians(
        surface, max(start, 4), opacity=_SEED_OPACITY, overlap=config.overlap, flatness=config.flatness
    )
    higher = torch.zeros(len(seeds), (config.sh_degree + 1) ** 2 - 1, 3)
    seeds = seeds.with_(sh=torch.cat([seeds.sh, higher], dim=1))
    prepare = target_over_measured if config.background == "measured" else target_from_view
    device = chosen_device(config.device)
    shown = [*views, *virtual_views(views, config.virtual_views)]
    targets = [prepare(view, device=device) for view in shown]
    filler: Fill | None = None
    if config.filling == "solid":
        filler = solid_filler(
            views,
            inner_count,
            cells=config.fill_cells,
            floor_z_m=table_z_m,
            opacity=config.inner_opacity,
            overlap=config.overlap,
            seed=config.seed,
        )
    elif config.filling == "paper":
        filler = paper_filler(_PAPER_CELLS, table_z_m)
    shell, inner = fit(
        seeds.to(device),
        targets,
        config,
        spacing_m=typical_spacing(seeds.means),
        max_count=shell_count,
        fill=filler,
        report=report,
    )
    return shell.to("cpu"), inner.to("cpu")


def usable_views(recording: Recording, warnings: list[str]) -> list[View]:
    """Read frame 0 of every camera that sees the object.

    Raises:
        PlopError: None does.
    """
    views = []
    for name in recording.camera_names:
        view = recording.view(name, 0)
        if int(view.object_mask.sum()) < _LEAST_PIXELS:
            warnings.append(f"camera {name} does not see the object at frame 0: not used")
        else:
            views.append(view)
    if not views:
        raise PlopError(
            "No camera sees the object at frame 0.",
            where=recording.path,
            expected=f"a mask with at least {_LEAST_PIXELS} pixels of the object",
            found=f"none in {', '.join(recording.camera_names) or 'no camera'}",
            fix="Check the masks (`plop view`), then run `plop ingest` again.",
        )
    return views


def _scan_views(recording: Recording) -> list[View]:
    """Read frames spread over the scans before the interaction, where they show the object."""
    views = []
    for name in recording.scan_names:
        frames = np.unique(np.linspace(0, recording.scan_length(name) - 1, _SCAN_VIEWS).astype(int))
        read = (recording.view(name, int(frame), group="scan") for frame in frames)
        views += [view for view in read if int(view.object_mask.sum()) >= _LEAST_PIXELS]
    return views


def _surface(recording: Recording, cloud: Path | None, training: list[View]) -> Surface:
    """Return the surface measured by the training views, from the fused cloud when there is one."""
    if cloud is None:
        surface = surface_from_views(training)
    else:
        # A point measured only by a held-out camera would leak the score's reference into the fit.
        surface = surface_from_cloud(cloud)
        extent = float(np.ptp(surface.points, axis=0).max())
        surface = surface.select(seen_by(surface.points, training, _SEEN_SHARE * extent))
    if len(surface.points) < _LEAST_POINTS:
        raise PlopError(
            "The object's surface was not measured.",
            where=cloud or recording.path,
            expected=f"at least {_LEAST_POINTS} points that a training camera sees",
            found=f"{len(surface.points)}",
            fix="Run `plop fuse` on these recordings again.",
        )
    longest = float(np.ptp(surface.points, axis=0).max())
    if not EXTENT_M[0] <= longest <= EXTENT_M[1]:
        raise PlopError(
            "The object's size cannot be in metres.",
            where=cloud or recording.path,
            expected=f"a longest side of {EXTENT_M[0]} to {EXTENT_M[1]} m",
            found=f"{longest:.4g} m",
            fix="Check the depth scale: millimetres must be divided by 1000.",
        )
    return surface
