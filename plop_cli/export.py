"""Copy an artifact's payload out of the workspace, with its manifest."""

from __future__ import annotations

import os
import shutil
from fnmatch import fnmatchcase
from pathlib import Path

from plop.artifacts.atomic_file import in_the_way
from plop.artifacts.layouts import Clouds, Fits, Model, Recordings, Rollouts, ScoreFiles, Tracks
from plop.artifacts.manifest import MANIFEST_NAME
from plop.artifacts.store import Artifact, Store
from plop.artifacts.verify import verify
from plop.errors import PlopError
from plop_cli.console import Console

_HERE = Path()
_FIT, _ROLLOUT = Fits(_HERE).episode("*"), Rollouts(_HERE).episode("*")
KINDS: dict[str, tuple[str | Path, ...]] = {
    "all": ("*",),
    "splats": (_FIT.object_splat, _FIT.tool_splat),
    "clouds": (Clouds(_HERE).cloud("*"),),
    "video": ("*.mp4",),
    "animation": (_ROLLOUT.frame(0).with_name("*.ply"),),
    "recordings": (Recordings(_HERE).episode("*"), Recordings(_HERE).index),
    "states": (_ROLLOUT.states, Tracks(_HERE).states("*")),
    "model": (Model(_HERE).weights, Model(_HERE).facts),
    "scores": (ScoreFiles(_HERE).report, ScoreFiles(_HERE).table),
    "pictures": ("*.png",),
}
"""Values of `--kind`: patterns over the payload's relative paths."""


def export(store: Store, console: Console, address: str, folder: Path, *, kind: str, force: bool) -> None:
    """Copy the files of one kind and the manifest into a folder.

    Raises:
        PlopError: No file of that kind, a damaged payload, an existing file, or one in place of a folder.
    """
    if kind not in KINDS:
        raise PlopError("There is no such kind of file.", expected=", ".join(KINDS), found=kind)
    if (file := in_the_way(folder)) is not None:
        raise PlopError(
            "The files cannot be copied: there is a file at the path of the folder.",
            where=file,
            expected="a folder, or a path that does not exist yet",
            found="a file",
            fix="Choose another folder.",
        )
    artifact = store.find(address)
    verify(artifact, store.cache)
    store.cache.save()
    names = [name for name in artifact.manifest.files if any(fnmatchcase(name, str(p)) for p in KINDS[kind])]
    if not names:
        raise PlopError(
            f"{artifact.address} has no {kind}.",
            where=artifact.path,
            found=", ".join(sorted(artifact.manifest.files)[:8]),
        )
    taken = [name for name in [*names, MANIFEST_NAME] if (folder / name).exists()]
    if taken and not force:
        raise PlopError(
            "The folder already contains these files.",
            where=folder / taken[0],
            fix="Choose another folder, or replace them with --force.",
        )
    for name in [*names, MANIFEST_NAME]:
        _copy(artifact, name, folder)
    console.say(f"{artifact.address}: {len(names)} files and {MANIFEST_NAME} in {folder}")
    console.result({"address": artifact.address, "folder": str(folder), "files": names})


def _copy(artifact: Artifact, name: str, folder: Path) -> None:
    target = folder / name
    draft = target.with_name(target.name + ".tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(artifact.path / name, draft)
        os.replace(draft, target)
    except OSError as error:
        if draft.is_file():
            draft.unlink()
        raise PlopError("A file cannot be written.", where=target, found=error.strerror or str(error)) from error
