"""Look at an artifact in 3D."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop_cli.console import Console


def view(store: Store, console: Console, address: str, *, episode: str | None, save: Path | None) -> None:
    """Show one episode of an artifact, or write it into a file for the viewer.

    Raises:
        PlopError: The viewer is not installed, or the artifact holds nothing to look at.
    """
    from plop.viewing import rerun_log

    artifact = store.find(address)
    folder = artifact.path
    names = _episodes(folder)
    if not names:
        raise PlopError(
            f"{artifact.address} holds nothing to look at in 3D.",
            where=folder,
            expected="an artifact of ingest, fuse, fit-init, filter, rollout or compare",
        )
    name = episode or names[0]
    if name not in names:
        raise PlopError("There is no such episode.", where=folder, expected=", ".join(names), found=name)
    rr = rerun_log.open_rerun("-".join(["plop", *artifact.key, name]), save)
    if (folder / "episodes" / f"{name}.h5").exists():
        rerun_log.log_recording(rr, folder / "episodes" / f"{name}.h5")
    if (folder / "clouds" / f"{name}.ply").exists():
        rerun_log.log_cloud(rr, folder / "clouds" / f"{name}.ply")
    for part in ("object", "tool"):
        if (folder / name / f"{part}.ply").exists():
            rerun_log.log_splat(rr, folder / name / f"{part}.ply", f"world/{part}")
    if (folder / "fields" / f"{name}.npz").exists():
        recording = _recording_of(store, artifact, name)
        if recording is not None:
            rerun_log.log_recording(rr, recording)
        rerun_log.log_field(rr, folder / "fields" / f"{name}.npz")
    for path in (folder / f"{name}.h5", folder / name / "states.h5"):
        if path.exists():
            rerun_log.log_trajectory(rr, path)
    console.say(f"{artifact.address} {name}: {'written to ' + str(save) if save else 'shown in the viewer'}")


def _recording_of(store: Store, artifact: Artifact, name: str) -> Path | None:
    """Find the recording that a comparison was made with; None when it is gone."""
    source = artifact.manifest.inputs.get("recordings", {})
    recordings = store.get(source["stage"], source["fingerprint"]) if "fingerprint" in source else None
    path = recordings.path / "episodes" / f"{name}.h5" if recordings is not None else None
    return path if path is not None and path.is_file() else None


def _episodes(folder: Path) -> list[str]:
    patterns = ("episodes/*.h5", "*.h5", "clouds/*.ply", "fields/*.npz")
    files = [path.stem for pattern in patterns for path in folder.glob(pattern)]
    folders = [path.parent.name for pattern in ("*/object.ply", "*/states.h5") for path in folder.glob(pattern)]
    return sorted({*files, *folders})
