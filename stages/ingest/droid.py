"""Turn DROID raw episodes into recordings: discovery, clocks, poses, depth, masks."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Recordings
from plop.checked_settings import check_choices, check_jobs, check_ranges
from plop.errors import PlopError
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.readers.droid.camera import DroidCameraSettings, DroidOptions
from plop.recordings.readers.droid.episode import RowChoice, open_episode
from plop.recordings.readers.droid.intrinsics import load_side_file
from plop.recordings.readers.droid.layout import DroidFolder, find_episodes
from plop.recordings.readers.droid.notes import WORKSPACE_M
from plop.recordings.readers.raw_folder import check_raw_folder
from plop.recordings.set import RecordingSet, check_patterns
from stages.ingest.droid_checks import moved_cameras
from stages.ingest.droid_write import WriteOptions, write_episode
from stages.ingest.masks import MaskRules

COMMAND = "ingest droid"


@dataclass(frozen=True)
class DroidConfig(DroidCameraSettings):
    """Settings of `ingest droid`, besides those of its cameras."""

    environment: str = ""
    """Name of the environment; empty = the lab's name."""
    episodes: tuple[str, ...] = ("*",)
    """Names of episodes to read (patterns with * and ?; a name is <LAB>_<date and time>)."""
    outcome: Literal["any", "success", "failure"] = "any"
    """Which episodes to read by their outcome."""
    test: tuple[str, ...] = ()
    """Names of test episodes (patterns); empty = every `test_every`-th."""
    test_every: int = 5
    """Without `test`, every n-th episode is for testing, and at least the last of several."""
    size: int = 320
    """Longest side of the stored pictures [px]; larger ones are shrunk, intrinsics with them."""
    keep_skipped: bool = False
    """Keep rows with skip_action."""
    idle_s: float = 1.0
    """Stretches in which the robot stands still are cut to this length [s]; 0 = kept whole."""
    idle_m: float = 0.002
    """Movement of the flange that counts as standing still [m]."""
    stride: int = 1
    """Keep every n-th row."""
    min_frames: int = 5
    """Episodes with fewer frames are skipped."""
    scan_frames: int = 40
    """Most frames of the wrist camera's scan."""
    workspace_min: tuple[float, float, float] = (0.2, -0.45, -0.1)
    """Lowest corner of the workspace where plop_episode.json gives none, robot base [m]."""
    workspace_max: tuple[float, float, float] = (0.85, 0.45, 0.5)
    """Highest corner of the workspace where plop_episode.json gives none, robot base [m]."""
    touch_m: float = 0.015
    """Distance to the object that counts as touching: the tool's mesh and its mount are known to about this [m]."""
    keep_untouched: bool = False
    """Keep episodes in which the tool never comes within touch_m of the object, instead of skipping them."""
    binary_masks: bool = False
    """With --masks: any value but 0 is the object (else the values are labels 0, 1, 2, 255)."""
    mask: MaskRules = field(default_factory=MaskRules)
    """How masks are made."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: DroidConfig, out: Output) -> Summary:
    """Ingest every episode; unusable ones are skipped and counted.

    Args:
        inputs: "raw", and perhaps "masks", "intrinsics", "extrinsics".
        config: Settings.
        out: Receives episodes/<name>.h5, reports/<name>.json and episodes.json.

    Raises:
        PlopError: A setting cannot be, there is no episode, or none that can be used.
    """
    _check(config)
    root = inputs["raw"].path
    found = find_episodes(root.resolve())
    chosen = _chosen(found, config, root)
    unfit = check_patterns([folder.name for folder in found], config.episodes, option="--episodes", where=root)
    unfit += check_patterns([folder.name for folder in chosen], config.test, option="--test", where=root)
    folders = {folder.name: folder for folder in chosen}
    work = partial(_ingest, folders, _droid_options(inputs, config, root), _write_options(inputs, config), config)
    done = out.map(list(folders), work, jobs=config.jobs, keep_going=True)
    reports = {
        name: done.values[name] if name in done.values else _skipped(folder, done.errors[name])
        for name, folder in folders.items()
    }
    for name, report in reports.items():
        write_json(Recordings(out.path).report(name), report)
    summary = _finish(reports, config, chosen, out, root)
    return replace(summary, warnings=unfit + summary.warnings)


def _check(config: DroidConfig) -> None:
    check_choices(config, COMMAND, {"outcome": ("any", "success", "failure")})
    check_jobs(config, COMMAND)
    check_ranges(
        config,
        COMMAND,
        {
            "size": (8, 8192),
            "stride": (1, 1e4),
            "min_frames": (2, 1e6),
            "scan_frames": (1, 1e4),
            "test_every": (2, 1e6),
            "idle_s": (0, 1e6),
            "idle_m": (0, 1),
            "touch_m": (0, 1),
            "exterior_focal_px": (0, 1e5),
            "wrist_focal_px": (0, 1e5),
            "baseline_m": (0, 1),
            "match_width": (16, 8192),
            "nearest_m": (0.01, 100),
            "farthest_m": (config.nearest_m, 1000),
            "camera_delay_ms": (-1e4, 1e4),
        },
    )
    rules = SimpleNamespace(**{f"mask.{key}": value for key, value in asdict(config.mask).items()})
    check_ranges(
        rules,
        COMMAND,
        {
            "mask.table_clear_m": (0, 0.5),
            "mask.tool_margin_m": (0, 0.5),
            "mask.tool_margin_px": (0, 100),
            "mask.hand_radius_m": (0, 1),
            "mask.hand_from_m": (-2, 2),
            "mask.hand_to_m": (config.mask.hand_from_m, 2),
            "mask.refine_px": (0, 100),
            "mask.refine_rounds": (0, 100),
            "mask.min_area_px": (0, 1e6),
        },
    )
    corners = {"workspace_min": config.workspace_min, "workspace_max": config.workspace_max}
    for name, corner in corners.items():
        if not np.abs(corner).max() <= WORKSPACE_M:
            raise PlopError(
                "A setting is out of range.",
                where=f"ingest.droid.{name}",
                found=str(corner),
                expected=f"each within {WORKSPACE_M:g} m of the robot's base",
            )
    if not (np.array(config.workspace_min) < config.workspace_max).all():
        raise PlopError(
            "The workspace has no inside.",
            where="ingest.droid.workspace_min, ingest.droid.workspace_max",
            expected="min below max on every axis",
            found=f"{config.workspace_min} .. {config.workspace_max}",
        )


def _check_given(config: DroidConfig, given: Mapping[str, str | Path]) -> None:
    _check(config)
    if "raw" in given:
        check_raw_folder(Path(given["raw"]), "droid")


def _chosen(found: list[DroidFolder], config: DroidConfig, root: Path) -> list[DroidFolder]:
    chosen = [
        folder
        for folder in found
        if any(fnmatch(folder.name, pattern) for pattern in config.episodes)
        and config.outcome in ("any", folder.outcome)
    ]
    if not chosen:
        raise PlopError(
            "No episode is chosen.",
            where=root,
            expected=f"names like {', '.join(config.episodes)}, outcome {config.outcome}",
            found=", ".join(folder.name for folder in found[:5])
            + (f" and {len(found) - 5} more" if len(found) > 5 else ""),
            fix="Correct episodes or outcome.",
        )
    return chosen


def _droid_options(inputs: Inputs, config: DroidConfig, root: Path) -> DroidOptions:
    paths = {}
    for name, file in (("intrinsics", "intrinsics.json"), ("extrinsics", "cam2base_extrinsics.json")):
        paths[name] = inputs[name].path if name in inputs else root / file
        if name in inputs and not paths[name].is_file():
            raise PlopError(
                f"There is no such file of {name}.",
                where=paths[name],
                expected=file,
                found="nothing",
                fix="Correct the path.",
            )
    return DroidOptions(
        config,
        load_side_file(paths["intrinsics"], "intrinsics"),
        paths["intrinsics"].name,
        load_side_file(paths["extrinsics"], "extrinsics"),
        paths["extrinsics"].name,
    )


def _write_options(inputs: Inputs, config: DroidConfig) -> WriteOptions:
    return WriteOptions(
        environment=config.environment,
        size=config.size,
        workspace=np.array([config.workspace_min, config.workspace_max]),
        rules=config.mask,
        masks=inputs["masks"].path if "masks" in inputs else None,
        binary_masks=config.binary_masks,
        touch_m=config.touch_m,
        keep_untouched=config.keep_untouched,
    )


def _ingest(
    folders: Mapping[str, DroidFolder],
    options: DroidOptions,
    write: WriteOptions,
    config: DroidConfig,
    name: str,
    out: Output,
) -> dict[str, Any]:
    """Ingest one episode; gives its report."""
    folder = folders[name]
    choice = RowChoice(
        config.keep_skipped, config.idle_s, config.idle_m, config.stride, config.min_frames, config.scan_frames
    )
    episode = open_episode(folder, options, choice)
    written = write_episode(
        episode,
        Recordings(out.path).episode(name),
        replace(write, environment=config.environment or folder.lab or "droid"),
        lambda done, total: out.progress(done, total, name, frames=done),
    )
    warnings = [_relative(text, folder.root) for text in [*episode.warnings, *written.warnings]]
    return {**_facts(folder), **asdict(written), "warnings": warnings}


def _facts(folder: DroidFolder) -> dict[str, Any]:
    """Begin the report of an episode."""
    return {
        "lab": folder.lab,
        "outcome": folder.outcome,
        "stamp": folder.stamp,
        "folder": folder.folder.relative_to(folder.root).as_posix(),
    }


def _skipped(folder: DroidFolder, error: PlopError) -> dict[str, Any]:
    """Report why an episode cannot be used."""
    reason = error.first_cause()
    said = _relative(reason.one_line(), folder.root)
    return {
        **_facts(folder),
        "skipped": said[:1] + said[1:].replace(f"{folder.name}: ", ""),  # the name stands before it already
        "fix": _relative(reason.fix or "", folder.root),
        "warnings": [_relative(text, folder.root) for text in error.noticed],
    }


def _finish(
    reports: Mapping[str, Mapping[str, Any]], config: DroidConfig, chosen: list[DroidFolder], out: Output, root: Path
) -> Summary:
    skipped = {name: str(report["skipped"]) for name, report in reports.items() if "skipped" in report}
    usable = [name for name in reports if name not in skipped]
    if not usable:
        advice = next((str(report["fix"]) for report in reports.values() if report.get("fix")), "")
        raise PlopError(
            "No episode can be used.",
            where=root,
            expected="one usable episode or more",
            found="\n    ".join(f"{name}: {reason}" for name, reason in skipped.items()),
            fix=f"{advice} See docs/how-to/droid-layout.md for what an episode must have.".strip(),
        )
    test = _test_names(usable, config)
    train = [name for name in usable if name not in test]
    environment = config.environment or chosen[0].lab or "droid"
    out.path.joinpath("episodes").mkdir(exist_ok=True)
    RecordingSet(out.path, environment, train, test, skipped).save()
    warnings = [f"{name} is skipped: {reason}" for name, reason in skipped.items()]
    warnings += [text for name in usable for text in reports[name]["warnings"]]
    warnings += moved_cameras({name: reports[name] for name in usable})
    if config.test and not test:
        warnings.append("no usable episode is a test episode")
    if not train:
        warnings.append("no episode is left for training: all usable ones are test episodes")
    columns = ("frames", "scan_frames", "depth", "object_px", "table_z_m", "closest_touch_mm")
    table = [
        {
            "episode": name,
            "cameras": len(reports[name]["cameras"]),
            **{key: reports[name][key] for key in columns},
            "split": "test" if name in test else "train",
        }
        for name in usable
    ]
    figures = {
        "environment": environment,
        "episodes": len(usable),
        "skipped": len(skipped),
        "frames": sum(reports[name]["frames"] for name in usable),
    }
    return Summary(figures=figures, table=table, warnings=list(dict.fromkeys(warnings)))


def _test_names(usable: list[str], config: DroidConfig) -> list[str]:
    if config.test:
        return [name for name in usable if any(fnmatch(name, pattern) for pattern in config.test)]
    return usable[config.test_every - 1 :: config.test_every] or (usable[-1:] if len(usable) > 1 else [])


def raw_files(folder: Path, config: DroidConfig) -> list[Path]:
    """List the raw files that are read; SVO files count only where the ZED SDK can read them."""
    from plop.recordings.readers.droid.depth import zed_sdk_present

    ignored = {"trajectory_im128.h5"}
    suffixes = () if zed_sdk_present() else (".svo", ".svo2")
    return sorted(
        path
        for path in folder.rglob("*")
        if path.is_file() and path.name not in ignored and path.suffix not in suffixes
    )


def _relative(text: str, root: Path) -> str:
    """Name files as seen from the raw folder: a payload holds no path of this machine."""
    text = text.replace(f"{root}{os.sep}", "")
    return re.sub(rf"{re.escape(str(root))}(?![\w-])", ".", text)


INGEST_DROID = Stage(
    name="ingest",
    version=2,
    help="Turn episodes of a DROID robot into recordings.",
    config=DroidConfig,
    inputs={
        "raw": InputSpec((), "Folder of DROID raw episodes: <LAB>/{success|failure}/<date>/<time>/."),
        "masks": InputSpec((), "Masks made elsewhere: <episode>/<serial>/<frame>.png.", optional=True),
        "intrinsics": InputSpec((), "intrinsics.json, by uuid; default: the raw folder's.", optional=True),
        "extrinsics": InputSpec((), "cam2base_extrinsics.json; default: the raw folder's.", optional=True),
    },
    run=run,
    check=_check_given,
    raw_files=raw_files,
)
