"""How far a pushed half slides along a turned blade: `python -m studies.turned_blade --data FOLDER`.

Reads the part recordings of DiSECt. On a table that rubs alike in all directions a half goes where the blade pushes it;
here friction is limited along x and y, each by itself, and the half goes along the nearer of the table's axes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from plop.tracking.episode import Episode
from studies.hidden_disect import episodes_of

SHAPES, MATERIALS = ("cylinder", "prism", "sphere"), ("foam", "jelly", "polymer")


def slide(episode: Episode) -> tuple[float, float, float]:
    """Tell how far the pushed half has gone by the end.

    Returns:
        Angle of the blade to the table's y axis [degrees], way along the push and way along the blade [mm].
    """
    poses, moved = episode.tool.world_from_tool, 1000 * (episode.points[-1] - episode.points[0])
    push = poses[-1, :2, 3] - poses[-4, :2, 3]
    push = push / np.linalg.norm(push)
    forward, aside = moved[:, :2] @ push, moved[:, :2] @ np.array([-push[1], push[0]])
    pushed = forward > forward.max() / 2
    angle = np.degrees(np.arctan2(poses[0, 1, 0], poses[0, 0, 0]))
    return float(angle), float(forward[pushed].mean()), float(aside[pushed].mean())


def line(folder: Path, environment: str) -> str:
    """Give one environment's line of the table; 004 and 005 are the test recordings."""
    cells = [
        f"{angle:.0f}: {forward:.0f}/{aside:.1f}"
        for angle, forward, aside in map(slide, episodes_of(folder, f"{environment}_part_*"))
    ]
    return f"| {environment.replace('_', '-')} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="Folder of the DiSECt recordings.")
    folder = parser.parse_args().data
    sys.stdout.write(
        "| environment | 000 | 001 | 002 | 003 | 004 (test) | 005 (test) |\n|---|---|---|---|---|---|---|\n"
    )
    for environment in (f"{shape}_{material}" for shape in SHAPES for material in MATERIALS):
        sys.stdout.write(line(folder, environment) + "\n")


if __name__ == "__main__":
    main()
