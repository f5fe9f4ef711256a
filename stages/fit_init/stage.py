"""fit-init: 3D Gaussians of the object and of the tool at frame 0 of every episode."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from PIL import Image

from plop.artifacts.atomic_file import whole, write_json
from plop.artifacts.layouts import Clouds, Fit, Fits
from plop.compute.device import jobs_on
from plop.errors import PlopError, remembering
from plop.gaussians.splat_ply import write_splat
from plop.pipeline.stage import Inputs, InputSpec, Output, Recipe, Stage, Summary
from plop.recordings.camera_verdicts import only_bad_cameras
from plop.recordings.set import RecordingSet
from plop.render.losses import RenderWeights
from plop.setting_kinds import ALL_CORES, AUTO_DEVICE, COMMON, Jobs, Range, Seed, Settings, Share, Unit, Weight
from stages.common_inputs import recordings_input
from stages.fit_init.episode import EpisodeFit, fit_episode

LearningRate = Annotated[float, Range(0, 1)]
"""Largest step of Adam."""


@dataclass(frozen=True)
class FitInitConfig(Settings):
    """Settings of `fit-init`; their defaults are defined only here."""

    episodes: Annotated[str, COMMON] = "*"
    """Only episodes whose name matches this pattern, e.g. "*_004"."""
    count: Annotated[int, Range(8, 1e7), Unit("Gaussians"), COMMON] = 3600
    """Gaussians of the object, inside included."""
    inner_share: Annotated[float, Range(0, 0.95)] = 0.33
    """Share of `count` that fills the inside ("solid" only)."""
    steps: Annotated[int, Range(0, 1e7), Unit("steps"), COMMON] = 2000
    """Optimisation steps, one view each."""
    held_out: Annotated[int, Range(0, 1000), Unit("cameras"), COMMON] = 1
    """Held-out cameras for the score: those that see the least that no other camera sees; at least two always train."""
    virtual_views: Annotated[int, Range(0, 1000), Unit("views"), COMMON] = 32
    """Virtual training views between the cameras, rendered from the measurements; 0 for none, as in the paper."""
    filling: Annotated[Literal["solid", "paper", "none"], COMMON] = "solid"
    """Inside: "solid" fills evenly, "paper" as in Sec. III-C, "none"."""
    fill_at: Share = 0.5
    """Filling happens after this share of the steps (10k of 20k in the paper)."""
    fill_cells: Annotated[int, Range(4, 256), Unit("cells")] = 32
    """Cells of the opacity grid along the object's longest side (16 in the paper, used for "paper" always)."""
    optimise_inside: bool = False
    """Whether inner Gaussians are optimised like those of the surface from then on, as in the paper."""
    inner_opacity: Share = 0.9
    """Opacity of the inner Gaussians."""
    overlap: Annotated[float, Range(0.05, 5)] = 0.6
    """Standard deviation of a new Gaussian as a share of the spacing."""
    flatness: Annotated[float, Range(1, 100)] = 10.0
    """Flatness of new surface Gaussians: standard deviation along the surface over the one across it. Thick ones
    overlap in depth, so that the rendered depth is behind the surface."""
    start_share: Annotated[float, Range(0.05, 1)] = 0.8
    """Initial share of the surface's Gaussians; densification adds the others."""
    densifications: Annotated[int, Range(0, 1000), Unit("rounds")] = 4
    """Rounds of densification and pruning, spread over the first half of the steps."""
    prune_opacity: Share = 0.05
    """Opacity below which surface Gaussians are removed in each round."""
    background: Literal["measured", "black"] = "measured"
    """Background: "measured" renders over the measured background, so that outlines may be soft;
    "black" crops the object with its mask."""
    sh_degree: Annotated[int, Range(0, 3)] = 0
    """Degree of the spherical harmonics; 0 is the same colour from everywhere."""
    render: RenderWeights = RenderWeights()
    """Weights of the rendering loss."""
    scene_size: Annotated[float, Range(0, 1e6), Unit("scene units")] = 0.0
    """Longest side of the object's cloud in scene units, in which `fit-init` and `train` then count depths and lengths
    of losses; 1 in the paper; 0 counts them in `render.depth_unit_m`."""
    anisotropy_weight: Weight = 0.1
    """Weight of the hinge on elongation."""
    anisotropy_ratio: Annotated[float, Range(1)] = 10.0
    """Elongation without a penalty."""
    max_scale: Annotated[float, Range(0.01, 100)] = 1.2
    """Largest standard deviation as a share of the seeds' spacing."""
    lr_means: LearningRate = 0.01
    """Learning rate of the means, in spacings of the seeds per step."""
    lr_quats: LearningRate = 0.005
    """Learning rate of the quaternions."""
    lr_scales: LearningRate = 0.01
    """Learning rate of log-scales."""
    lr_opacities: LearningRate = 0.03
    """Learning rate of opacity logits."""
    lr_sh: LearningRate = 0.02
    """Learning rate of the colours' coefficients."""
    tool_count: Annotated[int, Range(4, 1e6), Unit("Gaussians")] = 3000
    """Gaussians of the tool."""
    seed: Annotated[Seed, COMMON] = 0
    """Seed of the order of views and of the filling."""
    device: str = AUTO_DEVICE
    """Device: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core. Sequential on a GPU."""


def run(inputs: Inputs, config: FitInitConfig, out: Output) -> Summary:
    """Fit every episode: `<episode>/object.ply`, `<episode>/tool.ply`, pictures, and `fit.json` over all.

    An episode whose frame 0 cannot be fitted is skipped, with the reason in the summary.

    Raises:
        PlopError: An invalid setting, no episode selected, or none that can be fitted.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = [name for name in recordings.names if Path(name).match(config.episodes)]
    if not names:
        raise PlopError(
            "No episode is selected.",
            where=recordings.folder,
            expected=", ".join(recordings.names),
            found=f"episodes = {config.episodes!r}",
        )
    clouds = inputs["clouds"].path if "clouds" in inputs else None
    work, jobs = partial(_fit, recordings, clouds, config), jobs_on(config.device, config.jobs)
    done = out.map(names, work, jobs=jobs, keep_going=True)
    scores, skipped = done.values, done.errors
    if not scores:
        raise next(iter(skipped.values())).first_cause()
    reasons = {name: error.first_cause().problem for name, error in skipped.items()}
    facts = {"environment": recordings.environment, "episodes": scores, "skipped": reasons}
    write_json(Fits(out.path).facts, facts)
    return _summary(scores, skipped)


def _fit(
    recordings: RecordingSet, clouds: Path | None, config: FitInitConfig, name: str, out: Output
) -> dict[str, Any]:
    """Fit one episode; return its scores."""

    def report(step: int, figures: dict[str, float]) -> None:
        out.progress(step, max(config.steps, 1), name, **figures)

    bad = only_bad_cameras(recordings.folder)
    known = [bad[name]] if name in bad else []
    cloud = None if clouds is None else Clouds(clouds).cloud(name)
    with remembering(known), ExitStack() as opened:
        recording = opened.enter_context(recordings.open(name))
        shown = recording if name in recordings.train else None
        if shown is None and recordings.train:
            shown = opened.enter_context(recordings.open(recordings.train[0]))
        result = fit_episode(recording, shown, cloud, config, report)
        result.score["warnings"] = known + result.score["warnings"]
        _write_episode(Fits(out.path).episode(name), result)
    return result.score


def _write_episode(fit: Fit, result: EpisodeFit) -> None:
    write_splat(fit.object_splat, result.gaussians)
    write_splat(fit.tool_splat, result.tool)
    for name, picture in result.pictures.items():
        with whole(fit.picture(name)) as scratch:
            Image.fromarray(picture).save(scratch, format="PNG")
    write_json(fit.score, result.score)


def _summary(scores: dict[str, dict[str, Any]], skipped: dict[str, PlopError]) -> Summary:
    table = [
        {"episode": name, **{key: score[key] for key in ("gaussians", "inner", "psnr_db", "depth_error_mm")}}
        for name, score in scores.items()
    ]
    figures: dict[str, Any] = {"episodes": len(scores), "skipped": len(skipped)}
    for key in ("psnr_db", "depth_error_mm"):
        known = [score[key] for score in scores.values() if score[key] is not None]
        if known:
            figures[key] = round(float(np.mean(known)), 3)
    scales = [score["scene_scale"] for score in scores.values() if "scene_scale" in score]
    if scales:
        figures["scene_scale"] = float(np.median(scales))
    warnings = [f"{name}: {text}" for name, score in scores.items() for text in score["warnings"]]
    warnings += [f"{name} was skipped: {error.first_cause().one_line()}" for name, error in skipped.items()]
    return Summary(figures, table, warnings)


STAGE = Stage(
    name="fit-init",
    version=10,
    help="Fit 3D Gaussians to the first frame: object and tool.",
    config=FitInitConfig,
    inputs={
        "recordings": recordings_input("Recordings with cameras."),
        "clouds": InputSpec(
            ("fuse",),
            "Clouds to start from; depth images by default.",
            optional=True,
            recipe=Recipe({"recordings": "recordings"}),
        ),
    },
    run=run,
)
