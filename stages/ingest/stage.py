"""ingest disect, ingest mesh: render simulated episodes into recordings, seen by a ring of RGB-D cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from plop.artifacts.layouts import Recordings
from plop.errors import PlopError
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.overview import overview
from plop.recordings.readers.disect.episode import list_disect, read_disect
from plop.recordings.readers.mesh.sequence import MeshSequence, begun_at_rest, list_mesh_sequences, read_mesh_sequence
from plop.recordings.readers.raw_folder import check_raw_folder
from plop.recordings.readers.side_file import RawEpisode
from plop.recordings.set import RecordingSet, check_patterns, split_names
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.rig import camera_names
from plop.sensors.faults.library import parse_faults
from stages.ingest.checks import check_contact, check_plausible
from stages.ingest.selection import select
from stages.ingest.settings import DisectConfig, MeshConfig, SimulatedConfig
from stages.ingest.surface_checks import sound_surface


def _run(
    list_entries: Callable[[Path], list[RawEpisode]],
    read: Callable[[Path], MeshSequence],
    inputs: Inputs,
    config: SimulatedConfig,
    out: Output,
) -> Summary:
    raw = inputs["raw"].path
    if not raw.is_dir():
        raise PlopError(
            "There is no such folder.",
            where=raw,
            expected="a folder of raw recordings",
            found="nothing",
            fix="Correct the path.",
        )
    disturbances = Disturbances(parse_faults(config.fault, camera_names(config.cameras.count)))
    entries = select(list_entries(raw), environment=config.environment, episodes=config.episodes, where=raw)
    given = () if config.test == type(config)().test else config.test  # the defaults need not match every folder
    warnings = check_patterns([entry.name for entry in entries], given, option="--test", where=raw)
    raw_episodes = {entry.name: entry for entry in entries}
    work = partial(_ingest_one, raw_episodes, read, disturbances, config)
    done = out.map(list(raw_episodes), work, jobs=config.jobs, keep_going=config.skip_bad)
    skipped = {name: error.first_cause().one_line() for name, error in done.errors.items()}
    for name in raw_episodes:
        warnings += [f"{name} was left out: {skipped[name]}"] if name in skipped else done.values[name]
    usable = [entry for entry in entries if entry.name not in skipped]
    if not usable:
        raise PlopError(
            "No episode is usable.",
            where=raw,
            expected="at least one usable episode",
            found="\n    ".join(f"{name}: {why}" for name, why in skipped.items()),
            fix="Correct the first of these, then run the same command again.",
        )
    train, test = split_names([entry.name for entry in usable], config.test)
    recordings = RecordingSet(out.path, usable[0].environment, train, test, skipped)
    recordings.save()
    figures, table, seen = overview(recordings)
    return Summary(figures=figures, table=table, warnings=warnings + seen)


def _ingest_one(
    raw_episodes: Mapping[str, RawEpisode],
    read: Callable[[Path], MeshSequence],
    disturbances: Disturbances,
    config: SimulatedConfig,
    name: str,
    out: Output,
) -> list[str]:
    """Write one recording; return notes on unusual values."""
    entry = raw_episodes[name]
    arrays = entry.path.with_suffix(".npz")
    sequence = read(entry.path)
    sequence, odd = sound_surface(sequence, arrays)
    odd += check_plausible(sequence, arrays, config)
    sequence = begun_at_rest(sequence) if config.from_rest else sequence
    if not config.keep_untouched:
        check_contact(sequence, arrays)
    path = Recordings(out.path).episode(name)
    for share in record(path, sequence, config.cameras, disturbances, seed=config.seed):
        out.progress(share, 1, name)
    return [f"{name}: {note}" for note in (*sequence.notes, *odd)]


def _raw_files(
    list_entries: Callable[[Path], list[RawEpisode]], suffixes: tuple[str, ...], raw: Path, config: SimulatedConfig
) -> list[Path]:
    chosen = select(list_entries(raw), environment=config.environment, episodes=config.episodes, where=raw)
    paths = [entry.path.with_suffix(suffix) for entry in chosen for suffix in suffixes]
    return [path for path in paths if path.is_file()]


def _check(reader: str, config: SimulatedConfig, given: Mapping[str, str | Path]) -> None:
    if "raw" in given:
        check_raw_folder(Path(given["raw"]), reader)


INGEST_DISECT = Stage(
    name="ingest",
    version=2,
    help="Render DiSECt recordings (USD, npz, JSON) into multi-view RGB-D recordings.",
    config=DisectConfig,
    inputs={"raw": InputSpec((), "Folder with <name>.usd, <name>.npz and <name>.json.")},
    run=partial(_run, list_disect, read_disect),
    check=partial(_check, "disect"),
    raw_files=partial(_raw_files, list_disect, (".usd", ".npz", ".json")),
)

INGEST_MESH = Stage(
    name="ingest",
    version=2,
    help="Render mesh sequences of a simulator (npz, JSON) into multi-view RGB-D recordings.",
    config=MeshConfig,
    inputs={"raw": InputSpec((), "Folder with <name>.npz and <name>.json.")},
    run=partial(_run, list_mesh_sequences, read_mesh_sequence),
    check=partial(_check, "mesh"),
    raw_files=partial(_raw_files, list_mesh_sequences, (".npz", ".json")),
)
