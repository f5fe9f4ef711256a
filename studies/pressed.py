"""Does cohesion hold back what is pressed? `python -m studies.pressed` (ten minutes of one core).

The bound of cohesion is measured in a model's own tracks (stages/train/form.py). A press bends and shears more than a
cut, so that a bound too tight would show there: I2N learns from the followed points of held presses and pushes of the
scene `block`, and predicts others, with the measured bound, without, and with tighter ones. Writes
docs/results/pressed.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.missing_physics.points import SCENE, simulated
from plop.dynamics.model import PlopModel
from plop.pipeline.execute import versions
from studies.physics_learned import TRAINING, predicted, rms_m, track_of, train_once

SCENE_PRESS = replace(SCENE, motions=("hold", "push"))
TRAINED, UNSEEN = (3000, 8), (5000, 4)
"""Seed and number of the episodes to learn from and to predict."""
TIGHT_M = 3e-4
"""A bound as tight as those of the DiSECt environments (docs/results/cut_halves.json)."""


def bounds_m(model: PlopModel) -> Iterator[tuple[str, float | None]]:
    """What is tried, by what it is called."""
    measured = model.config.stray_m
    assert measured is not None
    yield from {"measured": measured, "none": None, "half": measured / 2, "tight": TIGHT_M}.items()


def main() -> None:
    """Train once, predict with each bound, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=-1, help="Processes that simulate.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-pressed"), help="Where the model is kept.")
    parser.add_argument("--out", type=Path, default=Path("docs/results/pressed.json"))
    options = parser.parse_args()
    model = train_once(
        options.work / "model",
        lambda: [track_of(episode) for episode in simulated(SCENE_PRESS, *TRAINED, [], options.jobs)],
        TRAINING,
        SCENE_PRESS.name,
        threads=1 if options.jobs == 1 else 2,
    )
    unseen, config = simulated(SCENE_PRESS, *UNSEEN, [], options.jobs), model.config
    found = {}
    for label, bound in bounds_m(model):
        model.config = replace(config, stray_m=bound)
        errors = [1000 * rms_m(episode, predicted(model, episode)) for episode in unseen]
        found[label] = {"stray_mm": bound and 1000 * bound, "rms_mm": errors}
        sys.stdout.write(f"{label}: {found[label]}\n")
    facts = {
        "command": "python -m studies.pressed",
        "versions": versions(),
        "seeds": [TRAINED[0], UNSEEN[0]],
        "episodes": [episode.name for episode in unseen],
        "bounds": found,
    }
    options.out.write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main()
