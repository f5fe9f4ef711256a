"""Look at an artifact in 3D."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.store import Store
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
        raise PlopError(f"{artifact.address} holds nothing to look at in 3D.", where=folder,
                        expected="an artifact of ingest, calibrate, fuse, fit-init, filter or rollout")  # fmt: skip
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
    for path in (folder / f"{name}.h5", folder / name / "states.h5"):
        if path.exists():
            rerun_log.log_trajectory(rr, path)
    console.say(f"{artifact.address} {name}: {'written to ' + str(save) if save else 'shown in the viewer'}")


def _episodes(folder: Path) -> list[str]:
    files = [path.stem for pattern in ("episodes/*.h5", "*.h5", "clouds/*.ply") for path in folder.glob(pattern)]
    folders = [path.parent.name for pattern in ("*/object.ply", "*/states.h5") for path in folder.glob(pattern)]
    return sorted({*files, *folders})
