"""Stages that do next to nothing, for tests of what runs them."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

from plop.pipeline.cluster_worker import spread
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.setting_kinds import Range, Seed, Settings, Unit


@dataclass(frozen=True)
class PiecesConfig(Settings):
    """Settings of the fake ingest."""

    pieces: Annotated[int, Range(0)] = 4
    """Number of files."""
    pause_s: Annotated[float, Range(0, 60), Unit("s")] = 0.0
    """Time a piece takes."""
    seed: Seed = 0
    """Added to every number."""


def write_pieces(inputs: Inputs, config: PiecesConfig, out: Output) -> Summary:
    """Write one file a piece; keep those that an earlier run finished."""
    text = "".join(path.read_text() for path in sorted(inputs["raw"].path.iterdir()))
    out.map([f"piece_{number}" for number in range(config.pieces)], partial(_write_piece, text, config), jobs=1)
    return Summary(figures={"pieces": config.pieces, "environment": inputs["raw"].path.name})


def _write_piece(text: str, config: PiecesConfig, name: str, out: Output) -> None:
    with (out.path / "attempts.log.tmp").open("a") as log:
        log.write(f"{name}\n")
    draft = out.path / f"{name}.txt.tmp"
    draft.write_text(text)
    time.sleep(config.pause_s)
    draft.write_text(f"{text}{int(name.removeprefix('piece_')) + config.seed}\n")
    os.replace(draft, out.path / f"{name}.txt")


@dataclass(frozen=True)
class JoinConfig:
    """Settings of the fake second stage."""

    upper: bool = False
    """Write capitals."""


def join_pieces(inputs: Inputs, config: JoinConfig, out: Output) -> Summary:
    """Join all pieces into one file."""
    texts = [path.read_text() for path in sorted(inputs["recordings"].path.glob("piece_*.txt"))]
    text = "".join(texts)
    (out.path / "sub").mkdir(exist_ok=True)
    (out.path / "sub" / "all.txt").write_text(text.upper() if config.upper else text)
    return Summary(figures={"characters": len(text)})


def compare(inputs: Inputs, config: JoinConfig, out: Output) -> Summary:
    """Need a joined artifact and the recordings it was made of."""
    (out.path / "names.txt").write_text(" ".join(sorted(inputs)))
    return Summary()


def map_pieces(inputs: Inputs, config: PiecesConfig, out: Output) -> Summary:
    """Write in each piece which process wrote it, wherever pieces are carried out."""
    names = [f"piece_{k}" for k in range(config.pieces)]
    list(spread(partial(write_process, out.path, config.pause_s), names, 1))
    return Summary(figures={"environment": "blocks"})


@dataclass(frozen=True)
class HandsOutConfig:
    """Settings of a stage that hands its work to a scheduler itself."""

    scheduler: str = field(default="", metadata={"in_fingerprint": False})
    """Address of the scheduler."""


def hand_out(inputs: Inputs, config: HandsOutConfig, out: Output) -> Summary:
    """Tell who runs it, and which scheduler it was given."""
    (out.path / "a.txt").write_text("")
    return Summary(figures={"process": os.getpid(), "scheduler": config.scheduler})


def write_process(folder: Path, pause_s: float, name: str) -> str:
    """Write one piece."""
    time.sleep(pause_s)
    (folder / f"{name}.txt").write_text(str(os.getpid()))
    return name


def fail(inputs: Inputs, config: JoinConfig, out: Output) -> Summary:
    """Write half of something, then run out of disk."""
    (out.path / "half.tmp").write_text("half")
    raise OSError(28, "No space left on device")


RECORDINGS = InputSpec(("calibrate", "ingest"), "Recordings.")
INGEST = Stage("ingest", 1, "Write pieces.", PiecesConfig, {"raw": InputSpec((), "A folder.")}, write_pieces)
CALIBRATE = Stage("calibrate", 1, "Join.", JoinConfig, {"recordings": InputSpec(("ingest",), "Pieces.")}, join_pieces)
FUSE = Stage("fuse", 1, "Join.", JoinConfig, {"recordings": InputSpec(("ingest",), "Pieces.")}, join_pieces)
FIT = Stage(
    "fit-init",
    1,
    "Compare.",
    JoinConfig,
    {"recordings": RECORDINGS, "clouds": InputSpec(("fuse",), "Clouds.", optional=True)},
    compare,
)
TRAIN = Stage(
    "train", 1, "Compare.", JoinConfig, {"recordings": RECORDINGS, "init": InputSpec(("fit-init",), "Fits.")}, compare
)
MAPPED = Stage("ingest", 1, "Map.", PiecesConfig, {"raw": InputSpec((), "A folder.")}, map_pieces)
HANDS_OUT = Stage(
    "diagnose",
    1,
    "Hand out.",
    HandsOutConfig,
    {"recordings": RECORDINGS, "clouds": InputSpec(("fuse",), "Clouds.")},
    hand_out,
)
FULL_DISK = Stage("fuse", 1, "Fail.", JoinConfig, {"recordings": InputSpec(("ingest",), "Pieces.")}, fail)


def raw_folder(path: Path, text: str = "raw ") -> Path:
    """Make a raw folder with one file."""
    path.mkdir(parents=True, exist_ok=True)
    (path / "data.txt").write_text(text)
    return path
