"""Print the paths of the pictures of a run; nothing is opened."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.layouts import ComparisonFiles, Rollouts
from plop.artifacts.store import Artifact, Store
from plop_cli.console import Console


def shown(path: Path) -> str:
    """Return a path relative to the current folder where that is shorter."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


def say_videos(console: Console, rollout: Artifact) -> dict[str, list[str]]:
    """Print the path of every episode's video and of its still.

    Returns:
        {"videos": [...], "stills": [...]}, as paths.
    """
    found: dict[str, list[str]] = {"videos": [], "stills": []}
    for each in Rollouts(rollout.path).all:
        video, still = each.video, each.still
        console.say(f"video (measured | predicted | distance in mm): {shown(video)}")
        found["videos"].append(str(video))
        if still.is_file():  # rollouts of earlier versions have none
            console.say(f"  picture of the largest difference: {shown(still)}")
            found["stills"].append(str(still))
    return found


def input_of(store: Store, artifact: Artifact, name: str) -> Artifact:
    """Return the artifact that was an input of another, e.g. "rollouts" of an eval."""
    source = artifact.manifest.inputs[name]
    return store.find(f"{source['stage']}@{source['fingerprint']}")


def worst_picture(comparison: Artifact) -> Path | None:
    """Return the picture of the error on the object in the episode with the largest error; None where there is none."""
    rows = [row for row in comparison.manifest.summary.get("table", []) if row.get("over") == "episode"]
    for row in sorted(rows, key=lambda row: -(row.get("rms_mm") or 0.0)):
        path = ComparisonFiles(comparison.path).on_object(row["where"])
        if path.is_file():
            return path
    return None
