"""fit-init: 3D Gaussians of the object and of the tool at frame 0 of every episode."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from plop.artifacts.atomic_file import whole, write_json
from plop.artifacts.layouts import Clouds, Fit, Fits
from plop.checked_settings import check_choices, check_jobs, check_ranges
from plop.compute.device import jobs_on
from plop.errors import PlopError, remembering
from plop.gaussians.splat_ply import write_splat
from plop.pipeline.stage import Inputs, InputSpec, Output, Recipe, Stage, Summary, settings_only
from plop.recordings.camera_verdicts import only_bad_cameras
from plop.recordings.set import RecordingSet
from stages.common_inputs import recordings_input
from stages.fit_init.episode import EpisodeFit, fit_episode

FILLINGS = ("solid", "paper", "none")
BACKGROUNDS = ("measured", "black")


@dataclass(frozen=True)
class FitInitConfig:
    """Settings of `fit-init`; their defaults are written only here."""

    episodes: str = "*"
    """Only episodes whose name matches this pattern, e.g. "*_004"."""
    count: int = 3600
    """Gaussians of the object, inside included."""
    inner_share: float = 0.33
    """Share of `count` that fills the inside ("solid" only)."""
    steps: int = 2000
    """Optimisation steps, one view each."""
    held_out: int = 1
    """Cameras that only score: those that see least that no other camera sees; at least two always train."""
    virtual_views: int = 32
    """Views between the cameras, drawn from what they measured, that train too; 0 for none, as in the paper."""
    filling: str = "solid"
    """Inside: "solid" fills evenly, "paper" as in Sec. III-C, "none"."""
    fill_at: float = 0.5
    """Filling happens after this share of the steps (10k of 20k in the paper)."""
    fill_cells: int = 32
    """Cells of the opacity grid along the object's longest side (16 in the paper, used for "paper" always)."""
    inner_opacity: float = 0.9
    """Opacity of the inner Gaussians."""
    overlap: float = 0.6
    """Standard deviation of a new Gaussian as a share of the spacing."""
    flatness: float = 10.0
    """Of new surface Gaussians: standard deviation along the surface over the one across it. Thick ones hide each
    other by halves, so that depth comes from behind the surface."""
    start_share: float = 0.8
    """Share of the surface's Gaussians that is there from the start; densification adds the others."""
    densifications: int = 4
    """Rounds of densification and pruning, spread over the first half of the steps."""
    prune_opacity: float = 0.05
    """Surface Gaussians below are removed in each round."""
    background: str = "measured"
    """Behind the object: "measured" lays renderings over the measured background, so that outlines may be soft;
    "black" cuts the object out with its mask."""
    sh_degree: int = 0
    """Degree of the spherical harmonics, 0 to 3; 0 is the same colour from everywhere."""
    ssim_weight: float = 0.1
    """Weight of 1 - SSIM."""
    l1_weight: float = 0.9
    """Weight of the mean absolute colour error."""
    depth_weight: float = 0.2
    """Weight of the mean absolute depth error, counted in `depth_unit_m`."""
    depth_unit_m: float = 0.1
    """Depth error that counts as 1 [m]; 1 in the paper."""
    mask_weight: float = 0.1
    """Weight of the mean absolute error of alpha against the mask; 0 in the paper."""
    anisotropy_weight: float = 0.1
    """Weight of the hinge on elongation."""
    anisotropy_ratio: float = 10.0
    """Elongation that costs nothing."""
    max_scale: float = 1.2
    """Largest standard deviation as a share of the seeds' spacing."""
    lr_means: float = 0.01
    """Learning rate of the means, in spacings of the seeds a step."""
    lr_quats: float = 0.005
    """Learning rate of the quaternions."""
    lr_scales: float = 0.01
    """Learning rate of log-scales."""
    lr_opacities: float = 0.03
    """Learning rate of opacity logits."""
    lr_sh: float = 0.02
    """Learning rate of the colours' coefficients."""
    tool_count: int = 3000
    """Gaussians of the tool."""
    seed: int = 0
    """Seed of the order of views and of the filling."""
    device: str = "auto"
    """Where it runs: "cpu", "cuda", "cuda:<number>", or "auto": cuda where there is one."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core. On a GPU one after the other."""


def run(inputs: Inputs, config: FitInitConfig, out: Output) -> Summary:
    """Fit every episode: `<episode>/object.ply`, `<episode>/tool.ply`, pictures, and `fit.json` over all.

    An episode whose frame 0 cannot be fitted is skipped, with the reason in the summary.

    Raises:
        PlopError: A setting that cannot be, no episode chosen, or none that can be fitted.
    """
    _check(config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    names = [name for name in recordings.names if Path(name).match(config.episodes)]
    if not names:
        raise PlopError(
            "No episode was chosen.",
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
    """Fit one episode; gives its scores."""

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


def _check(config: FitInitConfig) -> None:
    check_choices(config, "fit-init", {"filling": FILLINGS, "background": BACKGROUNDS})
    check_jobs(config, "fit-init")
    check_ranges(
        config,
        "fit-init",
        {
            "count": (8, 1e7),
            "inner_share": (0, 0.95),
            "steps": (0, 1e7),
            "sh_degree": (0, 3),
            "fill_at": (0, 1),
            "held_out": (0, 1000),
            "virtual_views": (0, 1000),
            "overlap": (0.05, 5),
            "flatness": (1, 100),
            "depth_unit_m": (1e-6, 1e6),
            "start_share": (0.05, 1),
            "fill_cells": (4, 256),
            "tool_count": (4, 1e6),
            "inner_opacity": (0, 1),
            "densifications": (0, 1000),
            "prune_opacity": (0, 1),
            "anisotropy_ratio": (1, inf),
            "max_scale": (0.01, 100),
            **{f"{name}_weight": (0, inf) for name in ("ssim", "l1", "depth", "mask", "anisotropy")},
            **{f"lr_{name}": (0, 1) for name in ("means", "quats", "scales", "opacities", "sh")},
        },
    )


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
    warnings = [f"{name}: {text}" for name, score in scores.items() for text in score["warnings"]]
    warnings += [f"{name} was skipped: {error.first_cause().one_line()}" for name, error in skipped.items()]
    return Summary(figures, table, warnings)


STAGE = Stage(
    name="fit-init",
    version=8,
    help="Fit 3D Gaussians to the first frame: object and tool.",
    config=FitInitConfig,
    inputs={
        "recordings": recordings_input("Recordings with cameras."),
        "clouds": InputSpec(
            ("fuse",),
            "Clouds to start from; without them depth images are used.",
            optional=True,
            recipe=Recipe({"recordings": "recordings"}),
        ),
    },
    run=run,
    check=settings_only(_check),
)
