"""Resampling on and off, and the three kernels: `python -m studies.ablations WORKSPACE OUT [ENVIRONMENT ...]`.

Takes an environment's last training of a workspace (`make reproduce` makes one). Each kernel is trained on the same
fits and tracks with the same settings; without resampling, and with thresholds at which it acts more, the same weights
are rolled out. The test episodes are scored on every fourth predicted frame and the last one, and the table is
printed. What is in the folder OUT already is not made again.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.workspace import latest
from plop.artifacts.store import Artifact, Store
from plop.dynamics.episodes import Actions
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.i2n.model_io import load_model
from plop.dynamics.interface import at_rest
from plop.dynamics.rollout import predict
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.metrics.frame import FrameOptions, score_frame
from plop.metrics.node_error import ancestor_means, move_nodes, rms_mm
from plop.metrics.table import replace_between_markers
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import flat_values
from plop.pipeline.stage import Input, Output
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.recordings.truth import Truth
from plop.render.scene import render_scene, tool_above_table
from stages.train.settings import TrainConfig
from stages.train.stage import STAGE as TRAIN

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "quadratic (27 nodes)": ("quadratic", {}),
    "quadratic, no resampling": ("quadratic", {"enabled": False}),
    "quadratic, split above 8": ("quadratic", {"split_above": 8.0}),
    "quadratic, split above 4": ("quadratic", {"split_above": 4.0}),
    "paper (8 nodes)": ("paper", {}),
    "cubic (64 nodes)": ("cubic", {}),
}
"""What a variant is called -> its kernel, and how its resampling differs from the training's."""
COLUMNS = {"cd_mm": "CD [mm]", "emd_mm": "EMD [mm]", "nodes_mm": "nodes [mm]"}
SCORED_EVERY = 4
WARM_UP = 3
"""Steps that are not timed."""

Row = dict[str, Any]


def inputs_of(store: Store, artifact: Artifact) -> dict[str, Input]:
    """Find the artifacts that one was made from."""
    found = {}
    for name, entry in artifact.manifest.inputs.items():
        source = store.get(entry["stage"], entry["fingerprint"])
        if source is None:
            raise SystemExit(f"{entry['stage']}@{entry['fingerprint'][:8]} is not in the workspace any more")
        found[name] = Input(source.path, source.manifest)
    return found


def train(trained: Artifact, inputs: Mapping[str, Input], kernel: str, folder: Path) -> Path:
    """Train with another kernel on the tracks of a training; gives the folder of the model."""
    if kernel == trained.manifest.config["network"]["kernel"]:
        return trained.path
    out = Output(folder / f"kernel-{kernel}")
    if not out.is_done("trained"):
        shutil.copytree(trained.path / "tracks", out.path / "tracks", dirs_exist_ok=True)
        for track in (out.path / "tracks").glob("*.h5"):
            out.mark_done(f"track-{track.stem}", json.loads(track.with_suffix(".json").read_text()))
        settings = {**dict(flat_values(trained.manifest.config)), "network.kernel": kernel}
        TRAIN.run(inputs, resolve(TrainConfig, "train", ("manifest", settings)), out)
        out.mark_done("trained")
    return out.path


def score(model: PlopModel, inputs: Mapping[str, Input]) -> Row:
    """Roll out the test episodes.

    Returns:
        {"episode": {score: mean}, "end": ..., "ms": processor time of a frame [ms], "gaussians": mean number at the
        end}.
    """
    recordings = RecordingSet.load(inputs["recordings"].path)
    rows: list[tuple[bool, dict[str, float]]] = []
    spent: list[float] = []
    counts: list[int] = []
    for name in recordings.test:
        start, tool = (read_splat(inputs["init"].path / name / f"{part}.ply") for part in ("object", "tool"))
        with recordings.open(name) as recording, Truth(recordings.path(name)) as truth:
            states = predict(model, at_rest(start), Actions.of(recording).steps(), name, 0)
            before = time.process_time()
            for frame, (state, _) in enumerate(states):
                spent += [time.process_time() - before] if frame > WARM_UP else []
                last = frame == len(recording) - 1
                if last or frame % SCORED_EVERY == 0 and frame:
                    rows.append((last, _scores(state.gaussians, start, tool, recording, truth, frame)))
                before = time.process_time()
            counts.append(len(state.gaussians))
    means = {
        part: {key: float(np.mean([row[key] for last, row in rows if last or part == "episode"])) for key in COLUMNS}
        for part in ("episode", "end")
    }
    return {**means, "ms": 1000 * float(np.median(spent)), "gaussians": float(np.mean(counts))}


def _scores(
    now: Gaussians, start: Gaussians, tool: Gaussians, recording: Recording, truth: Truth, frame: int
) -> dict[str, float]:
    views = [recording.view(camera, frame) for camera in recording.camera_names]
    placed = tool_above_table(tool, recording.world_from_tool[frame], recording.table_z_m)
    drawn = render_scene(now, placed, [view.camera for view in views])
    found = score_frame(drawn, views, FrameOptions())
    (known, before), (names, after) = (
        ancestor_means(g.ids.numpy(), g.means.double().numpy(), g.opacities.numpy()) for g in (start, now)
    )
    kept = np.isin(names, known)
    carried = move_nodes(truth.nodes_m(0), before[np.searchsorted(known, names[kept])], after[kept])
    clouds = {key: float(found[key] or 0) for key in ("cd_mm", "emd_mm")}
    return {**clouds, "nodes_mm": rms_mm(carried, truth.nodes_m(frame))}


def line(environment: str, label: str, scores: Row) -> str:
    """Give one line of the table."""
    cells = [f"{scores[part][key]:.2f}" for part in ("episode", "end") for key in COLUMNS]
    return "| " + " | ".join([environment, label, *cells, f"{scores['ms']:.1f}"]) + " |"


def table(lines: Iterable[str]) -> str:
    """Put the heading over the lines."""
    heads = [f"{title}, {part}" for part in ("whole", "end") for title in COLUMNS.values()]
    first = "| " + " | ".join(["environment", "variant", *heads, "ms a frame"]) + " |"
    return "\n".join([first, "|---|---|" + "---|" * (len(heads) + 1), *lines])


def main(workspace: Path, folder: Path, environments: list[str]) -> None:
    """Run all variants and write the table."""
    torch.set_num_threads(1)
    store = Store(workspace)
    known = sorted({a.manifest.environment for a in store.artifacts("train")})
    lines = []
    for environment in environments or known[:1]:
        trained = latest(store, "train", environment)
        inputs = inputs_of(store, trained)
        for label, (kernel, changes) in VARIANTS.items():
            here = folder / environment
            kept = here / f"{label.split(' (')[0].replace(', ', '-').replace(' ', '-')}.json"
            if not kept.is_file():
                path = train(trained, inputs, kernel, here)
                model = load_model(path, torch.device("cpu"))
                model.config = replace(model.config, resampling=replace(model.config.resampling, **changes))
                here.mkdir(parents=True, exist_ok=True)
                kept.write_text(json.dumps(score(model, inputs)))
            scores = json.loads(kept.read_text())
            lines.append(line(environment, f"{label}: {scores['gaussians']:.0f} Gaussians at the end", scores))
            sys.stdout.write(lines[-1] + "\n")
            sys.stdout.flush()
            sys.stdout.write(table(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
