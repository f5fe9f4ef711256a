"""Which artifacts of a workspace are stale with respect to the present stages."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from plop.artifacts.fingerprint import deciding
from plop.artifacts.lineage import Key
from plop.artifacts.stale import Stale, stale_reasons
from plop.artifacts.store import Artifact, Store
from plop.pipeline.execute import raw_content
from plop.pipeline.registry import StageRef, stage_ref
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import SETTINGS_FILE, flat_values
from plop.pipeline.stage import Stage


def stale(store: Store, artifacts: list[Artifact]) -> dict[Key, Stale]:
    """Explain why artifacts are stale, as far as their stages can be imported.

    Args:
        store: The workspace.
        artifacts: All artifacts, least recently used first.

    Raises:
        PlopError: One descends from itself.
    """
    stages = _imported_stages(artifacts)

    def raw_digest(artifact: Artifact, name: str, path: Path) -> str | None:
        stage = stages.get(command_of(artifact))
        if stage is None:
            return None
        return raw_content(store, stage, path, recorded_config(artifact, stage, {}))

    reasons = stale_reasons(store, artifacts, {name: stage.version for name, stage in stages.items()}, raw_digest)
    store.cache.save()
    return reasons


def command_of(artifact: Artifact) -> str:
    """Return the command that made an artifact."""
    return str(artifact.manifest.provenance.get("command", artifact.manifest.stage))


def recorded_config(artifact: Artifact, stage: Stage, written: dict[str, Any]) -> Any:
    """Return the settings of an artifact; those without influence on results, such as jobs, are the workspace's.

    Args:
        artifact: The artifact.
        stage: Its stage.
        written: Settings of the stage in plop.toml.

    Raises:
        PlopError: One of them no longer exists in the stage.
    """
    recorded = dict(flat_values(artifact.manifest.config))
    free = {field.name for field in fields(stage.config)} - deciding(stage.config()).keys()
    kept = {key: value for key, value in recorded.items() if key.partition(".")[0] not in free}
    own = {key: value for key, value in written.items() if key.partition(".")[0] in free}
    return resolve(stage.config, command_of(artifact), (SETTINGS_FILE, own), (artifact.address, kept))


def ref_of(artifact: Artifact) -> StageRef | None:
    """Return the stage that made an artifact; None where it no longer exists."""
    try:
        return stage_ref(command_of(artifact))
    except KeyError:
        return None


def _imported_stages(artifacts: list[Artifact]) -> dict[str, Stage]:
    """Import the stages of the artifacts, by command and by name; one that cannot be imported is left out."""
    found: dict[str, Stage] = {}
    for artifact in artifacts:
        ref = ref_of(artifact)
        if ref is not None and ref.command not in found:
            try:
                found[ref.command] = ref.load()
            except (ImportError, OSError):
                continue
            found.setdefault(artifact.manifest.stage, found[ref.command])
    return found
