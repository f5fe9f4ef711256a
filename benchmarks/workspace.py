"""A workspace as benchmarks use it: commands typed in it, as a user would, and what they made."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.store import Artifact, Store
from plop_cli.app import app


class Typed:
    """Types commands in a workspace."""

    def __init__(self, workspace: Path, settings: str = "") -> None:
        """Make the workspace.

        Args:
            workspace: Its folder.
            settings: What its plop.toml holds; one that is there stays, and without any none is written.
        """
        self.workspace, self.store = workspace, Store(workspace)
        workspace.mkdir(parents=True, exist_ok=True)
        written = workspace / "plop.toml"
        if settings and not written.is_file():
            written.write_text(settings)

    def plop(self, *words: str) -> None:
        """Run one command; what is finished is not run again.

        Raises:
            PlopError: It failed.
        """
        app([*words, "-w", str(self.workspace), "--quiet"], prog_name="plop", standalone_mode=False)


def latest(store: Store, stage: str, environment: str) -> Artifact:
    """Give the last artifact of a stage for an environment."""
    return [a for a in store.artifacts(stage) if a.manifest.environment == environment][-1]
