"""A workspace for benchmarks: runs commands in it as a user would, and finds their artifacts."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.store import Artifact, Store
from plop_cli.app import app


class Typed:
    """Runs commands in a workspace."""

    def __init__(self, workspace: Path, settings: str = "") -> None:
        """Make the workspace.

        Args:
            workspace: Its folder.
            settings: Content of its plop.toml; an existing file is kept, and without settings none is written.
        """
        self.workspace, self.store = workspace, Store(workspace)
        workspace.mkdir(parents=True, exist_ok=True)
        written = workspace / "plop.toml"
        if settings and not written.is_file():
            written.write_text(settings)

    def plop(self, *words: str) -> None:
        """Run one command; finished stages are skipped.

        Raises:
            PlopError: It failed.
        """
        app([*words, "-w", str(self.workspace), "--quiet"], prog_name="plop", standalone_mode=False)


def latest(store: Store, stage: str, environment: str) -> Artifact:
    """Return the last artifact of a stage for an environment."""
    return [a for a in store.artifacts(stage) if a.manifest.environment == environment][-1]
