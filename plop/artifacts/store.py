"""The store: artifacts of one workspace, found by address, added atomically.

artifacts/<stage>/<fingerprint>/            manifest.json and the payload
artifacts/<stage>/.partial-<fingerprint>/   scratch folder of a run that is active or was killed
artifacts/names.json                        names given with --name
artifacts/journal.jsonl                     what was made or requested, in order
artifacts/.cache/, artifacts/.locks/        may be removed while no run is active

No library, since the tools for it (DVC, MLflow) bind results to a Git checkout or to a server; here a folder that can
be moved holds everything, and an address follows from what determines the result.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.atomic_file import in_the_way
from plop.artifacts.commit import committed, restore
from plop.artifacts.digest import DigestCache, content_digest
from plop.artifacts.journal import Event, Journal
from plop.artifacts.lock import locked, note_of
from plop.artifacts.manifest import Manifest, content_files, read_manifest
from plop.artifacts.names import give_name, read_names
from plop.artifacts.suggestions import nearest, workspaces_near
from plop.errors import PlopError

BEGIN = "`plop ingest FOLDER` or `plop simulate SCENE` creates one from data, `plop demo` an example"
"""How to create a workspace."""


@dataclass(frozen=True)
class Artifact:
    """One finished artifact."""

    path: Path
    """Its folder: the payload with manifest.json in it."""
    manifest: Manifest

    def __fspath__(self) -> str:
        """Return the folder, so that an artifact can be used as a path."""
        return str(self.path)

    @property
    def key(self) -> tuple[str, str]:
        """Stage and fingerprint."""
        return self.manifest.stage, self.manifest.fingerprint

    @property
    def address(self) -> str:
        """Short address, e.g. `train@3f9a1c04`."""
        return self.manifest.address

    @property
    def made(self) -> str:
        """When it was made, ISO date and time; "" when the manifest does not record it."""
        return str(self.manifest.provenance.get("made", ""))

    @property
    def content(self) -> str:
        """Digest of the payload without its logs, as the manifest gives it."""
        return content_digest(content_files(self.manifest))


class Store:
    """The artifacts below one workspace folder."""

    def __init__(self, workspace: str | Path = ".", *, warn: Callable[[str], None] | None = None) -> None:
        """Open a workspace; it need not exist.

        Args:
            workspace: Its folder.
            warn: Called with a message for each artifact that `latest` had to skip.

        Raises:
            PlopError: There is a file at the folder's path.
        """
        self.workspace = Path(workspace).resolve()
        self.root = self.workspace / "artifacts"
        self._warn = warn
        if (file := in_the_way(self.root)) is not None:
            raise PlopError(
                "The workspace cannot be created: there is a file at its path.",
                where=file,
                expected="a folder, or a path that does not exist yet",
                found="a file",
                fix="Choose another workspace with -w (--workspace) or PLOP_WORKSPACE.",
            )
        self.cache = DigestCache(self.root / ".cache" / "digests.json")
        self.journal = Journal(self.root / "journal.jsonl")

    def check_begun(self) -> None:
        """Reject a folder that is not a workspace, for commands that only read one.

        Raises:
            PlopError: It does not exist, or has no artifacts/; says how to create a workspace, and lists nearby ones.
        """
        if self.root.is_dir():
            return
        there = self.workspace.is_dir()
        near = ", ".join(f"-w {path}" for path in workspaces_near(self.workspace)[:3])
        raise PlopError(
            "There is no workspace here yet." if there else "There is no such workspace.",
            where=self.workspace,
            expected="a folder with artifacts/ in it",
            found="a folder without artifacts/" if there else "nothing",
            fix=(f"Perhaps {near}. " if near else "") + f"{BEGIN}.",
        )

    def shared(self, stage: str) -> Path:
        """Return the cache folder that runs of a stage share; it need not exist."""
        return self.root / ".cache" / stage

    def lock_path(self, stage: str, fingerprint: str) -> Path:
        """Return the lock file of one fingerprint."""
        return self.root / ".locks" / f"{stage}-{fingerprint}"

    @contextmanager
    def making(
        self, stage: str, fingerprint: str, reads: Sequence[Artifact], on_wait: Callable[[str], None] | None = None
    ) -> Iterator[None]:
        """Hold the lock of an artifact while it is made; its inputs are protected from removal meanwhile.

        Args:
            stage: Its stage.
            fingerprint: Its fingerprint.
            reads: Its inputs.
            on_wait: Called once with the holder's process id when another run is making it.

        Raises:
            PlopError: An input was removed in the meantime.
        """
        with locked(self.lock_path(stage, fingerprint), on_wait, note=["@".join(a.key) for a in reads]):
            with self.removing():  # from here on a removing process sees the note
                gone = [a.address for a in reads if not a.path.is_dir()]
            if gone:
                raise PlopError(
                    "An input was removed while the run started.",
                    where=self.root,
                    found=", ".join(gone),
                    fix="Run the same command again.",
                )
            yield

    @contextmanager
    def removing(self) -> Iterator[None]:
        """Hold the lock for the removal of artifacts; only for a short time."""
        with locked(self.root / ".locks" / "removing"):
            yield

    def read_by_others(self) -> set[tuple[str, str]]:
        """Return the inputs of active runs, by stage and fingerprint."""
        notes = [note_of(path) or [] for path in (self.root / ".locks").glob("*")]
        return {(stage, mark) for note in notes for stage, _, mark in [line.partition("@") for line in note]}

    def final_path(self, stage: str, fingerprint: str) -> Path:
        """Return the folder of a finished artifact."""
        return self.root / stage / fingerprint

    def get(self, stage: str, fingerprint: str) -> Artifact | None:
        """Return an artifact by its full fingerprint, None when it is not there."""
        folder = self.final_path(stage, fingerprint)
        return Artifact(folder, read_manifest(folder)) if folder.is_dir() else None

    def artifacts(self, *stages: str) -> list[Artifact]:
        """List the readable artifacts of the stages (of all without arguments), least recently used first."""
        found = []
        for folder in self._folders(stages):
            try:
                found.append(Artifact(folder, read_manifest(folder)))
            except PlopError:
                continue  # `unreadable` reports it; one damaged artifact must not block the others
        order = self.journal.order()
        return sorted(found, key=lambda a: (order.get(a.key, -1), str(a.manifest.provenance.get("made", ""))))

    def unreadable(self, *stages: str) -> dict[Path, PlopError]:
        """List artifacts of the stages whose manifest is missing, damaged or too new, least recently used first."""
        problems = {}
        for folder in self._folders(stages):
            try:
                read_manifest(folder)
            except PlopError as error:
                problems[folder] = error
        order = self.journal.order()
        return dict(sorted(problems.items(), key=lambda item: order.get(_key_of(item[0]), -1)))

    def passed_over(self, *stages: str, taken: Artifact | None = None) -> PlopError | None:
        """Return why the latest artifact of some stages cannot be read; None when it can.

        Args:
            stages: The stages that were searched.
            taken: The artifact used instead; older ones were not skipped.
        """
        order = self.journal.order()
        after = -2 if taken is None else order.get(taken.key, -1)
        later = [error for path, error in self.unreadable(*stages).items() if order.get(_key_of(path), -1) > after]
        return later[-1] if later else None

    def warn_passed_over(self, *stages: str, taken: Artifact | None) -> None:
        """Warn of an artifact that is more recent than the one in use, but cannot be read."""
        reason = self.passed_over(*stages, taken=taken)
        if reason is not None and self._warn is not None:
            kept = f"no artifact of {' or '.join(stages)}" if taken is None else taken.address
            self._warn(f"{kept} is used; a later one was skipped ({reason.where}): {reason.problem}")

    def _folders(self, stages: tuple[str, ...]) -> list[Path]:
        if not self.root.is_dir():
            return []
        roots = [self.root / name for name in stages] if stages else sorted(self.root.iterdir())
        return [
            folder
            for root in roots
            if _visible_folder(root)
            for folder in sorted(root.iterdir())
            if _visible_folder(folder)
        ]

    def find(self, address: str) -> Artifact:
        """Resolve `train@3f9a1c`, `train@latest` or a name.

        Raises:
            PlopError: No artifact matches, or several do.
        """
        self.check_begun()
        if "@" not in address:
            names = self.names()
            if address not in names:
                raise self._unknown(address)
            address = names[address]
        stage, _, prefix = address.partition("@")
        if prefix == "latest":
            known = self.artifacts(stage)
            if not known:
                raise self.passed_over(stage) or self._unknown(address, f"There is no artifact of `{stage}`")
            self.warn_passed_over(stage, taken=known[-1])
            return known[-1]
        fits = [folder for folder in self._folders((stage,)) if prefix and folder.name.startswith(prefix)]
        if len(fits) == 1:
            return Artifact(fits[0], read_manifest(fits[0]))
        if fits:
            raise PlopError(
                "The address matches several artifacts.",
                where=address,
                expected="a longer prefix",
                found=", ".join(f"{stage}@{folder.name}" for folder in fits),
            )
        raise self._unknown(address)

    def _unknown(self, address: str, problem: str = "") -> PlopError:
        close = nearest(address, self.artifacts(), self.names())
        return PlopError(
            f"{problem or f'There is no artifact {address!r}'} in this workspace.",
            where=self.root,
            expected="stage@prefix, stage@latest or a name given with --name",
            found=f"nothing; perhaps {'; '.join(close)}" if close else "an empty workspace",
            fix="`plop status` lists the artifacts; -w chooses another workspace.",
        )

    def names(self) -> dict[str, str]:
        """Return all names: name -> full address."""
        return read_names(self.root)

    def set_name(self, name: str, artifact: Artifact) -> str | None:
        """Name an artifact, see `plop.artifacts.names.give_name`."""
        return give_name(self.root, name, "@".join(artifact.key))

    def scratch(self, stage: str, fingerprint: str, *, fresh: bool = False) -> Path:
        """Return the scratch folder of a fingerprint, with the files of a killed run unless `fresh`. Hold its lock."""
        restore(self.final_path(stage, fingerprint))
        folder = self.root / stage / f".partial-{fingerprint}"
        if fresh and folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def drop_empty(self, scratch: Path) -> None:
        """Remove the scratch folder of a failed run, unless it holds a file to resume from. Hold its lock."""
        if not any(path.is_file() for path in scratch.rglob("*")):
            shutil.rmtree(scratch, ignore_errors=True)

    def commit(self, scratch: Path, manifest: Manifest) -> Artifact:
        """Convert a scratch folder into an artifact: hash the payload, write the manifest, rename. Hold its lock.

        Hidden entries and `*.tmp` files belong to the run and are discarded.
        """
        final = self.final_path(manifest.stage, manifest.fingerprint)
        return Artifact(final, committed(scratch, final, manifest))

    def record(self, artifact: Artifact, seconds: float | None) -> None:
        """Make an artifact the latest of its stage; a journal that cannot be written is not an error."""
        try:
            self.journal.append(Event(*artifact.key, seconds))
        except OSError:
            return


def _key_of(folder: Path) -> tuple[str, str]:
    return folder.parent.name, folder.name


def _visible_folder(path: Path) -> bool:
    return path.is_dir() and not path.name.startswith(".")
