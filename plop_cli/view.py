"""Show an artifact in 3D."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.layouts import Clouds, ComparisonFiles, Fits, Recordings, Rollouts, Tracks
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop_cli.console import Console


def view(store: Store, console: Console, address: str, *, episode: str | None, save: Path | None) -> None:
    """Show one episode of an artifact, or write it into a file for the viewer.

    Raises:
        PlopError: The viewer is not installed, or the artifact has nothing to show.
    """
    from plop.viewing import rerun_log

    artifact = store.find(address)
    folder = artifact.path
    names = _episodes(folder)
    if not names:
        raise PlopError(
            f"{artifact.address} has nothing to show in 3D.",
            where=folder,
            expected="an artifact of ingest, fuse, fit-init, filter, rollout or compare",
        )
    name = episode or names[0]
    if name not in names:
        raise PlopError("There is no such episode.", where=folder, expected=", ".join(names), found=name)
    rr = rerun_log.open_rerun("-".join(["plop", *artifact.key, name]), save)
    if (path := Recordings(folder).episode(name)).exists():
        rerun_log.log_recording(rr, path)
    if (path := Clouds(folder).cloud(name)).exists():
        rerun_log.log_cloud(rr, path)
    fit = Fits(folder).episode(name)
    for part, path in (("object", fit.object_splat), ("tool", fit.tool_splat)):
        if path.exists():
            rerun_log.log_splat(rr, path, f"world/{part}")
    if (field := ComparisonFiles(folder).field(name)).exists():
        recording = _recording_of(store, artifact, name)
        if recording is not None:
            rerun_log.log_recording(rr, recording)
        rerun_log.log_field(rr, field)
    for path in (Tracks(folder).states(name), Rollouts(folder).episode(name).states):
        if path.exists():
            rerun_log.log_trajectory(rr, path)
    console.say(f"{artifact.address} {name}: {'written to ' + str(save) if save else 'shown in the viewer'}")


def _recording_of(store: Store, artifact: Artifact, name: str) -> Path | None:
    """Find the recording that a comparison was made with; None when it is gone."""
    source = artifact.manifest.inputs.get("recordings", {})
    recordings = store.get(source["stage"], source["fingerprint"]) if "fingerprint" in source else None
    path = Recordings(recordings.path).episode(name) if recordings is not None else None
    return path if path is not None and path.is_file() else None


def _episodes(folder: Path) -> list[str]:
    here, each = Path(), "*"
    files = Recordings(here).episode(each), Tracks(here).states(each), Clouds(here).cloud(each)
    folders = Fits(here).episode(each).object_splat, Rollouts(here).episode(each).states
    names = {path.stem for file in (*files, ComparisonFiles(here).field(each)) for path in folder.glob(str(file))}
    return sorted(names | {path.parent.name for file in folders for path in folder.glob(str(file))})
