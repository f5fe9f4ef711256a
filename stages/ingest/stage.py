"""ingest disect, ingest mesh: render simulated episodes into recordings, seen by a ring of RGB-D cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.recordings.disect import list_disect, read_disect
from plop.recordings.mesh_sequence import MeshSequence, list_mesh_sequences, read_mesh_sequence
from plop.recordings.recording import MaskLabel, Recording
from plop.recordings.set import RecordingSet
from plop.render.blender import BlenderRenderer
from plop.render.mesh_raycast import Light, Look, MeshRenderer
from plop.render.texture import SolidTexture, seed_from
from stages.contract import Inputs, InputSpec, Output, Stage, Summary
from stages.ingest.checks import check_scale, contact_warning
from stages.ingest.noise import add_depth_noise
from stages.ingest.render_episode import Render, write_episode
from stages.ingest.rig import ring_cameras
from stages.ingest.selection import Entry, select, split_names
from stages.ingest.settings import DisectConfig, MeshConfig, SimulatedConfig, check_config


def _run(
    list_entries: Callable[[Path], list[Any]],
    read: Callable[[Path], MeshSequence],
    inputs: Inputs,
    config: SimulatedConfig,
    out: Output,
) -> Summary:
    check_config(config)
    raw = inputs["raw"].path
    if not raw.is_dir():
        raise PlopError("There is no such folder.", where=raw, expected="a folder of raw recordings", found="nothing",
                        fix="Correct the path.")  # fmt: skip
    entries = select(list_entries(raw), environment=config.environment, episodes=config.episodes, where=raw)
    skipped: dict[str, str] = {}
    warnings: list[str] = []
    for index, entry in enumerate(entries):
        try:
            warnings += _ingest_one(entry, read, config, out, index, len(entries))
        except PlopError as error:
            if not config.skip_bad:
                raise
            skipped[entry.name] = error.problem
            warnings.append(f"{entry.name} was left out: {error.problem} ({error.found})")
    names = [entry.name for entry in entries if entry.name not in skipped]
    if not names:
        raise PlopError("No episode can be used.", where=raw, expected="at least one good episode",
                        found="; ".join(f"{name}: {why}" for name, why in skipped.items()))  # fmt: skip
    train, test = split_names(names, config.test)
    recordings = RecordingSet(out.path, entries[0].environment, train, test, skipped)
    recordings.save()
    warnings += [
        f"No episode is kept for {what}." for what, kept in (("training", train), ("the test", test)) if not kept
    ]
    return _summary(recordings, warnings)


def _ingest_one(
    entry: Entry, read: Callable[[Path], MeshSequence], config: SimulatedConfig, out: Output, index: int, total: int
) -> list[str]:
    """Write one recording unless it is there; return what deserves a warning."""
    sequence = read(entry.path)
    check_scale(sequence, workspace_m=config.workspace_m)
    if not out.is_done(entry.name):
        path = out.path / "episodes" / f"{entry.name}.h5"
        for share in _render(path, sequence, config):
            out.progress(index + share, total, entry.name)
        out.mark_done(entry.name)
    warning = contact_warning(sequence)
    return [warning] if warning else []


def _render(path: Path, sequence: MeshSequence, config: SimulatedConfig) -> Iterator[float]:
    """Write one recording; yield the share that is done, 0..1."""
    cameras = ring_cameras(
        sequence.rest, count=config.cameras, size_px=config.size, fov_deg=config.fov_deg, low_deg=config.low_deg,
        high_deg=config.high_deg, azimuth_deg=config.azimuth_deg, room_m=config.room_m, distance_m=config.distance_m,
    )  # fmt: skip

    def sensor(depth_m: np.ndarray, camera: str, frame: int) -> np.ndarray:
        return add_depth_noise(
            depth_m, noise_m=config.depth_noise_m, quantization_m=config.depth_quantization_m,
            dropout=config.depth_dropout, seed=(config.seed, sequence.name, camera, frame),
        )  # fmt: skip

    images = len(sequence) * len(cameras)
    with ExitStack() as stack:
        render = _renderer(sequence, cameras, config, stack)
        for done in write_episode(path, sequence, cameras, render, sensor):
            yield done / images


def _renderer(sequence: MeshSequence, cameras: list[Camera], config: SimulatedConfig, stack: ExitStack) -> Render:
    texture = SolidTexture.from_seed(seed_from(sequence.environment, config.seed))
    look = Look(texture, Light(config.ambient, config.directional))
    if config.renderer == "raycast":
        return MeshRenderer(sequence, look, supersample=config.supersample).render
    exact = MeshRenderer(sequence, look, supersample=1)
    blender = stack.enter_context(
        BlenderRenderer(sequence, look, cameras, executable=config.blender, samples=config.blender_samples)
    )
    return lambda frame, camera: blender.recolour(exact.render(frame, camera), frame, camera)


def _summary(recordings: RecordingSet, warnings: list[str]) -> Summary:
    """Tell what the recordings hold, from the files themselves, so that a resumed run says the same."""
    table = []
    for name in recordings.names:
        with Recording(recordings.path(name)) as recording:
            seen = {camera: _fewest_object_pixels(recording, camera) for camera in recording.camera_names}
            times = recording.time_s
        warnings += [f"{name}: {camera} loses sight of the object." for camera, pixels in seen.items() if not pixels]
        table.append(
            {
                "episode": name,
                "split": "train" if name in recordings.train else "test",
                "frames": len(times),
                "seconds": round(float(times[-1] - times[0]), 3),
                "cameras": len(seen),
                "object_px_min": min(seen.values()),
                "megabytes": round(recordings.path(name).stat().st_size / 1e6, 2),
            }
        )
    figures = {
        "environment": recordings.environment,
        "train": len(recordings.train),
        "test": len(recordings.test),
        "skipped": len(recordings.skipped),
        "frames": sum(int(row["frames"]) for row in table),
    }
    return Summary(figures=figures, table=table, warnings=warnings)


def _fewest_object_pixels(recording: Recording, camera: str) -> int:
    counts = [int((recording.mask(camera, frame) == MaskLabel.OBJECT).sum()) for frame in range(len(recording))]
    return min(counts)


def _raw_files(
    list_entries: Callable[[Path], list[Any]], suffixes: tuple[str, ...], raw: Path, config: SimulatedConfig
) -> list[Path]:
    chosen = select(list_entries(raw), environment=config.environment, episodes=config.episodes, where=raw)
    paths = [entry.path.with_suffix(suffix) for entry in chosen for suffix in suffixes]
    return [path for path in paths if path.is_file()]


INGEST_DISECT = Stage(
    name="ingest",
    version=1,
    help="Render DiSECt recordings (USD, npz, JSON) into multi-view RGB-D recordings.",
    config=DisectConfig,
    inputs={"raw": InputSpec((), "Folder with <name>.usd, <name>.npz and <name>.json.")},
    run=partial(_run, list_disect, read_disect),
    raw_files=partial(_raw_files, list_disect, (".usd", ".npz", ".json")),
)

INGEST_MESH = Stage(
    name="ingest",
    version=1,
    help="Render mesh sequences of a simulator (npz, JSON) into multi-view RGB-D recordings.",
    config=MeshConfig,
    inputs={"raw": InputSpec((), "Folder with <name>.npz and <name>.json.")},
    run=partial(_run, list_mesh_sequences, read_mesh_sequence),
    raw_files=partial(_raw_files, list_mesh_sequences, (".npz", ".json")),
)
