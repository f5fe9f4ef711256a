"""Ingest raw DROID folders in tests, and look into them."""

from __future__ import annotations

from pathlib import Path

import h5py

from plop.pipeline.settings import resolve
from plop.pipeline.stage import Input, Output, Summary
from plop.recordings.set import RecordingSet
from stages.ingest.droid import INGEST_DROID, DroidConfig


def episode_of(raw: Path) -> Path:
    return next(raw.glob("*/*/*/*/trajectory.h5")).parent


def ingest(raw: Path, out: Path, **settings) -> tuple[Summary, RecordingSet]:
    """Ingest with settings by key; those of a group as `rows__stride`."""
    extra = {key: Input(settings.pop(key)) for key in ("masks", "intrinsics", "extrinsics") if key in settings}
    out.mkdir(parents=True, exist_ok=True)
    given = {key.replace("__", "."): value for key, value in settings.items()}
    config = resolve(DroidConfig, "ingest droid", ("test", given))
    summary = INGEST_DROID.run({"raw": Input(raw), **extra}, config, Output(out))
    return summary, RecordingSet.load(out)


def said(summary: Summary, *words: str) -> bool:
    return any(all(word in text for word in words) for text in summary.warnings)


def edit(raw: Path):
    return h5py.File(episode_of(raw) / "trajectory.h5", "r+")
