"""Runs of `ingest mesh` on drawn boxes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from plop.pipeline.stage import Input, Output, Summary
from plop.recordings.readers.mesh.sequence import MeshSequence, write_mesh_sequence
from plop.render.virtual_cameras.settings import CameraSettings
from stages.ingest.settings import MeshConfig
from stages.ingest.stage import INGEST_MESH
from tests.support.box_sequence import box_sequence

BOX = box_sequence()


SMALL = MeshConfig(cameras=CameraSettings(size=24, count=2, supersample=1))


def filmed(config: MeshConfig, **cameras: object) -> MeshConfig:
    return dataclasses.replace(config, cameras=dataclasses.replace(config.cameras, **cameras))


def ingest(raw: Path, folder: Path, config: MeshConfig = SMALL) -> Summary:
    folder.mkdir(exist_ok=True)
    return INGEST_MESH.run({"raw": Input(raw)}, config, Output(folder))


def raw_folder(folder: Path, *sequences: MeshSequence) -> Path:
    for sequence in sequences or [box_sequence(f"box_{index:03d}") for index in range(4)]:
        write_mesh_sequence(folder, sequence)
    return folder


def payload(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".done" not in path.parts and path.suffix != ".tmp"
    }
