"""How near the filter follows what moves: `python -m studies.track_errors --workspace W RECORDINGS FILTER ...`.

Compares followed points with the material they began on, which a simulated recording knows (`/truth`): while they are
in sight and from when the tool first covers them apart, for each kind of motion.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from plop.artifacts.store import Artifact, Store
from plop.recordings.truth import Truth
from plop.tracking.episode import Episode
from plop.tracking.phases import motion_kind
from plop.tracking.tracks import episode_from_track

_AROUND = 6
"""Vertices of the true surface whose motion, by inverse square distance, is a followed point's."""
_PARTED_M = 0.012
"""Points whose vertices end farther apart than this lie at a cut: where they went is not known."""


class Followed(NamedTuple):
    """True and followed displacement of the points of one episode."""

    kind: str
    true_m: np.ndarray
    """[T, P, 3]."""
    found_m: np.ndarray
    seen: np.ndarray
    """[T, P]; False from when the tool first covered a point."""


def followed(recording: Path, episode: Episode) -> Followed:
    """Set an episode's points beside the truth."""
    with Truth(recording) as truth:
        vertices = np.stack([truth.surface(frame).vertices for frame in range(len(truth))])
    distance, near = cKDTree(vertices[0]).query(episode.points[0], k=_AROUND)
    weight = 1 / np.maximum(distance, 1e-4) ** 2
    weight /= weight.sum(1, keepdims=True)
    ends = vertices[-1][near]
    whole = np.linalg.norm(ends - ends.mean(1, keepdims=True), axis=2).max(1) < _PARTED_M
    true = (vertices[:, near] * weight[None, :, :, None]).sum(2)
    true, found = true - true[0], episode.points - episode.points[0]
    seen = np.ones(true.shape[:2], bool) if episode.seen is None else episode.seen
    return Followed(motion_kind(episode), true[:, whole], found[:, whole], seen[:, whole])


def episodes_of(store: Store, recordings: Artifact, filtered: Artifact) -> list[Followed]:
    """Read all episodes that a filter followed."""
    init = store.get("fit-init", str(filtered.manifest.inputs["init"]["fingerprint"]))
    if init is None:
        raise SystemExit("The Gaussians that were followed are gone.")
    found = []
    for path in sorted(filtered.path.glob("*.h5")):
        recording = recordings.path / "episodes" / path.name
        found.append(followed(recording, episode_from_track(recording, init.path / path.stem / "object.ply", path)))
    return found


def rows(name: str, episodes: list[Followed]) -> list[str]:
    """Write one line for each kind of motion."""
    kinds = defaultdict(list)
    for episode in episodes:
        kinds[episode.kind].append(episode)
    return [
        f"| {name} | {kind} ({len(group)}) | {_cell(group, covered=False)} | {_cell(group, covered=True)} |"
        for kind, group in sorted(kinds.items())
    ]


def _cell(group: list[Followed], *, covered: bool) -> str:
    """RMS motion, RMS error, and how much of the motion is followed: the slope of found against true."""
    true = np.concatenate([each.true_m[each.seen != covered] for each in group])
    found = np.concatenate([each.found_m[each.seen != covered] for each in group])
    if not len(true):
        return "-"
    motion, error = (1000 * np.sqrt((values**2).sum(-1).mean()) for values in (true, found - true))
    return f"{motion:.2f}, {error:.2f}, {(true * found).sum() / (true**2).sum():.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workspace", type=Path, required=True, help="Holds the artifacts.")
    parser.add_argument("recordings", help="Simulated recordings.")
    parser.add_argument("filters", nargs="+", help="Artifacts of `plop filter`.")
    options = parser.parse_args()
    store = Store(options.workspace)
    recordings = store.find(options.recordings)
    lines = [
        "| filter | motion (episodes) | seen: motion [mm], error [mm], share followed | covered by the tool |",
        "|---|---|---|---|",
    ]
    for name in options.filters:
        lines += rows(name, episodes_of(store, recordings, store.find(name)))
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
