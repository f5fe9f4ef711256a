"""Convert DROID raw episodes to recordings: discovery, clocks, poses, depth, masks."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Recordings
from plop.errors import PlopError
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.readers.droid.camera_settings import DroidCameraSettings, DroidOptions
from plop.recordings.readers.droid.episode import RowChoice, open_episode
from plop.recordings.readers.droid.intrinsics import load_side_file
from plop.recordings.readers.droid.layout import DroidFolder, find_episodes
from plop.recordings.readers.droid.notes import WORKSPACE_M
from plop.recordings.readers.raw_folder import check_raw_folder
from plop.recordings.set import RecordingSet, check_patterns
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Settings, Unit
from stages.ingest.droid_checks import moved_cameras
from stages.ingest.droid_write import WriteOptions, write_episode
from stages.ingest.masks import MaskRules

Corner = Annotated[tuple[float, float, float], Range(-WORKSPACE_M, WORKSPACE_M), Unit("m")]
"""Corner of a box, robot base."""


@dataclass(frozen=True)
class DroidConfig(Settings):
    """Settings of `ingest droid`; their defaults are defined only here."""

    environment: Annotated[str, COMMON] = ""
    """Name of the environment; empty = the lab's name."""
    episodes: Annotated[tuple[str, ...], COMMON] = ("*",)
    """Names of episodes to read (patterns with * and ?; a name is <LAB>_<date and time>)."""
    outcome: Annotated[Literal["any", "success", "failure"], COMMON] = "any"
    """Which episodes to read by their outcome."""
    test: Annotated[tuple[str, ...], COMMON] = ()
    """Names of test episodes (patterns); empty = every `test_every`-th."""
    test_every: Annotated[int, Range(2, 1e6), Unit("episodes")] = 5
    """Without `test`, every n-th episode is for testing, and at least the last of several."""
    size: Annotated[int, Range(8, 8192), Unit("px"), COMMON] = 320
    """Longest side of the stored images; larger ones are downscaled, with their intrinsics."""
    workspace_min: Annotated[Corner, COMMON] = (0.2, -0.45, -0.1)
    """Lowest corner of the workspace where plop_episode.json gives none, robot base."""
    workspace_max: Annotated[Corner, COMMON] = (0.85, 0.45, 0.5)
    """Highest corner of the workspace where plop_episode.json gives none, robot base."""
    touch_m: Annotated[float, Range(0, 1), Unit("m")] = 0.015
    """Largest distance to the object that counts as contact: the accuracy of the tool's mesh and mount."""
    keep_untouched: bool = False
    """Keep episodes in which the tool never comes within touch_m of the object, instead of skipping them."""
    binary_masks: bool = False
    """With --masks: any value but 0 is the object (else the values are labels 0, 1, 2, 255)."""
    cameras: DroidCameraSettings = DroidCameraSettings()
    """Facts about the cameras that are missing in the files."""
    rows: RowChoice = RowChoice()
    """Selection of the rows of a trajectory."""
    mask: MaskRules = MaskRules()
    """Rules of the masks."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.array(self.workspace_min) < self.workspace_max).all():
            raise PlopError(
                "The workspace is empty.",
                where="workspace_min, workspace_max",
                expected="min below max on every axis",
                found=f"{self.workspace_min} .. {self.workspace_max}",
                fix="Swap the numbers that are in the wrong order.",
            )


def run(inputs: Inputs, config: DroidConfig, out: Output) -> Summary:
    """Ingest every episode; unusable ones are skipped and counted.

    Args:
        inputs: "raw", and perhaps "masks", "intrinsics", "extrinsics".
        config: Settings.
        out: Receives episodes/<name>.h5, reports/<name>.json and episodes.json.

    Raises:
        PlopError: A setting is invalid, there is no episode, or none is usable.
    """
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


def _check(config: DroidConfig, given: Mapping[str, str | Path]) -> None:
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
            "No episode is selected.",
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
        config.cameras,
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
    """Ingest one episode; return its report."""
    folder = folders[name]
    episode = open_episode(folder, options, config.rows)
    written = write_episode(
        episode,
        Recordings(out.path).episode(name),
        replace(write, environment=config.environment or folder.lab or "droid"),
        lambda done, total: out.progress(done, total, name, frames=done),
    )
    warnings = [_relative(text, folder.root) for text in [*episode.warnings, *written.warnings]]
    return {**_facts(folder), **asdict(written), "warnings": warnings}


def _facts(folder: DroidFolder) -> dict[str, Any]:
    """Create the report of an episode."""
    return {
        "lab": folder.lab,
        "outcome": folder.outcome,
        "stamp": folder.stamp,
        "folder": folder.folder.relative_to(folder.root).as_posix(),
    }


def _skipped(folder: DroidFolder, error: PlopError) -> dict[str, Any]:
    """Report why an episode is not usable."""
    reason = error.first_cause()
    said = _relative(reason.one_line(), folder.root)
    return {
        **_facts(folder),
        "skipped": said[:1] + said[1:].replace(f"{folder.name}: ", ""),  # the name precedes it already
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
            "No episode is usable.",
            where=root,
            expected="at least one usable episode",
            found="\n    ".join(f"{name}: {reason}" for name, reason in skipped.items()),
            fix=f"{advice} See docs/how-to/droid-layout.md for the requirements.".strip(),
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
    """List the raw files that are read; SVO files only where the ZED SDK can read them."""
    from plop.recordings.readers.droid.depth import zed_sdk_present

    ignored = {"trajectory_im128.h5"}
    suffixes = () if zed_sdk_present() else (".svo", ".svo2")
    return sorted(
        path
        for path in folder.rglob("*")
        if path.is_file() and path.name not in ignored and path.suffix not in suffixes
    )


def _relative(text: str, root: Path) -> str:
    """Return paths relative to the raw folder: a payload must not contain absolute paths."""
    text = text.replace(f"{root}{os.sep}", "")
    return re.sub(rf"{re.escape(str(root))}(?![\w-])", ".", text)


INGEST_DROID = Stage(
    name="ingest",
    version=2,
    help="Convert episodes of a DROID robot to recordings.",
    config=DroidConfig,
    inputs={
        "raw": InputSpec((), "Folder of DROID raw episodes: <LAB>/{success|failure}/<date>/<time>/."),
        "masks": InputSpec((), "External masks: <episode>/<serial>/<frame>.png.", optional=True),
        "intrinsics": InputSpec((), "intrinsics.json, by uuid; default: the raw folder's.", optional=True),
        "extrinsics": InputSpec((), "cam2base_extrinsics.json; default: the raw folder's.", optional=True),
    },
    run=run,
    check=_check,
    raw_files=raw_files,
)
