"""Faults of cameras and tool: found, or invented? `python -m benchmarks.missing_physics.sensors --seeds 7000 7010`.

Each seed is one set of motions of a shipped scene, four episodes as `plop simulate` makes them. Its motions are filmed
by right cameras, and by a rig in which four of six cameras have a fault each; the robot's own faults are written into
what the right cameras recorded. Goes on where it stopped; writes docs/results/sensor_faults.json.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.missing_physics.rates import proportion
from plop.artifacts.atomic_file import write_json
from plop.physics.scenes import find_scene
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.rig import camera_names
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.estimation.estimate import estimate_sensors, pool
from plop.sensors.estimation.finding import State
from plop.sensors.faults.library import Faults, parse_faults
from plop.sensors.faults.tool import Tool

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "sensor_faults.json"
SCENES = ("block.toml", "sphere.toml", "cylinder.toml")
EPISODES, SIZE_PX, COLOUR_NOISE = 4, 96, 2.0
NOISES_M = (0.0005, 0.001, 0.002)
CAMERAS = camera_names(6)
SIZES = {"clock": 0.03, "depth_scale": 0.01, "pose_shift": 0.003, "pose_turn": float(np.radians(1))}
"""Size of each fault of a camera: 30 ms, 1 %, 3 mm, 1 deg; signs and directions are drawn."""
LIBRARY = {"clock": "clock", "depth_scale": "depth_scale", "pose_shift": "pose_error", "pose_turn": "pose_error"}
"""Its name in the library of faults."""


TOOLS = {
    "robot_clock": ("robot_clock={:+.3f}", 0.03),
    "tool_offset": ("tool_offset.x_m={0:+.3f} tool_offset.y_m={1:+.3f} tool_offset.z_m={0:+.3f}", -0.002, -0.001),
    "tool_thickness": ("tool_thickness=-0.003",),
}
"""Fault of the tool, all of 3 mm or 30 ms, as typed behind `--fault`, and values whose sign is drawn."""


@dataclass(frozen=True)
class Verdict:
    """What was hidden in one set, and what was said of it."""

    hidden: dict[str, str]
    """Camera, or "tool" -> the kind of its fault."""
    said: dict[str, list[str]]
    """Camera, or "tool" -> faults, alternatives included."""
    unjudged: list[str]


def motions(seed: int) -> list[MeshSequence]:
    """Simulate the episodes of one seed."""
    scene = Scene.read(find_scene(Path(SCENES[seed % len(SCENES)])))
    scene = replace(scene, seed=scene.seed + seed, episodes=EPISODES)
    return [simulate_episode(scene, k) for k in range(EPISODES)]


def film(folder: Path, sequences: Sequence[MeshSequence], faults: Sequence[str], seed: int) -> None:
    """Film them from a direction and with a noise that the seed draws."""
    draw = np.random.default_rng([seed, len(faults)])
    cameras = CameraSettings(
        size=SIZE_PX, supersample=1, depth_noise_m=float(draw.choice(NOISES_M)), azimuth_deg=float(draw.uniform(0, 60))
    )
    folder.mkdir(parents=True, exist_ok=True)
    disturbed = Disturbances(parse_faults(faults, CAMERAS), COLOUR_NOISE)
    for k, sequence in enumerate(sequences):
        for _ in record(folder / f"{k}.h5", sequence, cameras, disturbed, seed=seed):
            pass


def drawn(seed: int) -> tuple[dict[str, str], list[str]]:
    """Draw which cameras have which faults; gives them by camera, and as typed behind `--fault`."""
    draw = np.random.default_rng([seed, 1])
    hidden = dict(zip(draw.permutation(CAMERAS).tolist(), SIZES, strict=False))
    typed = []
    for camera, kind in hidden.items():
        size, direction = SIZES[kind] * draw.choice([-1, 1]), draw.normal(size=3)
        direction *= size / np.linalg.norm(direction)
        keys = {"pose_shift": "{}_m", "pose_turn": "r{}_rad"}.get(kind)
        if keys:
            typed += [f"pose_error.{keys.format(a)}={v:.6f}@{camera}" for a, v in zip("xyz", direction, strict=True)]
        else:
            typed.append(f"{kind}={size + (kind == 'depth_scale'):.6f}@{camera}")
    return hidden, typed


def judged(folder: Path, hidden: dict[str, str]) -> Verdict:
    """Judge the episodes of a folder as `plop diagnose` does."""
    rig = pool([estimate_sensors(path) for path in sorted(folder.glob("*.h5"))])
    said = {each.camera: [name for f in each.found for name in (f.fault, *f.alternatives)] for each in rig.cameras}
    said["tool"] = [rig.tool.fault, *rig.tool.alternatives] if rig.tool else []
    unjudged = [each.camera for each in rig.cameras if each.state is State.CANNOT_BE_JUDGED]
    return Verdict(hidden, said, unjudged)


def one_seed(work: Path, seed: int) -> dict[str, Verdict]:
    """Make and judge the sets of one seed: right, cameras, and one for each fault of the tool."""
    sequences, folder = motions(seed), work / f"{seed}"
    film(folder / "right", sequences, [], seed)
    hidden, wrong = drawn(seed)
    film(folder / "cameras", sequences, wrong, seed)
    found = {"right": judged(folder / "right", {}), "cameras": judged(folder / "cameras", hidden)}
    for name, (typed, *sizes) in TOOLS.items():
        faults = parse_faults(typed.format(*((-1) ** seed * size for size in sizes)).split())
        shutil.copytree(folder / "right", folder / name, dirs_exist_ok=True)
        for path in (folder / name).glob("*.h5"):
            write_tool(path, faults)
        found[name] = judged(folder / name, {"tool": name})
        shutil.rmtree(folder / name)
    return found


def write_tool(path: Path, faults: Faults) -> None:
    """Write what a robot with these faults would have said into what right cameras recorded."""
    with h5py.File(path, "a") as file:
        poses, mesh = file["tool/world_from_tool"], file["tool/mesh/vertices"]
        said = faults.recorded_tool(Tool(file["frames/time_s"][:], poses[:], mesh[:], file["tool/mesh/faces"][:]))
        poses[...], mesh[...] = said.world_from_tool, said.vertices


def scored(rows: Sequence[dict[str, Verdict]]) -> dict[str, Any]:
    """Count, with Wilson's 95 % interval."""
    right, cameras = [row["right"] for row in rows], [row["cameras"] for row in rows]
    accused = [any(v.said[c] for c in v.said if c not in v.hidden) for v in right + cameras]
    rates = {
        "right_set_accused": proportion(sum(accused[: len(right)]), len(right)),
        "right_camera_accused": proportion(
            sum(bool(v.said[c]) for v in right + cameras for c in CAMERAS if c not in v.hidden),
            sum(c not in v.hidden for v in right + cameras for c in CAMERAS),
        ),
        "tool_accused_without_fault": proportion(sum(bool(v.said["tool"]) for v in right + cameras), 2 * len(rows)),
        "right_camera_not_judged": proportion(sum(len(v.unjudged) for v in right), len(CAMERAS) * len(right)),
    }
    for kind, name in LIBRARY.items():
        pairs = [(v, c) for v in cameras for c, hidden in v.hidden.items() if hidden == kind]
        rates[f"{kind}_found"] = proportion(sum(name in v.said[c] for v, c in pairs), len(pairs))
        rates[f"{kind}_not_judged"] = proportion(sum(c in v.unjudged for v, c in pairs), len(pairs))
    for name in TOOLS:
        rates[f"{name}_found"] = proportion(sum(name in row[name].said["tool"] for row in rows), len(rows))
        rates[f"{name}_noticed"] = proportion(sum(any(row[name].said.values()) for row in rows), len(rows))
    return rates


def main() -> None:
    """Make the rows that are lacking, and count them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, nargs=2, default=(6000, 6006), metavar=("FIRST", "END"))
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-sensors"), help="Recordings and rows.")
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    rows = []
    for seed in range(*options.seeds):
        path = options.work / f"{seed}.json"
        if not path.is_file():
            options.work.mkdir(parents=True, exist_ok=True)
            write_json(path, {name: vars(v) for name, v in one_seed(options.work, seed).items()}, sort_keys=False)
        rows.append({name: Verdict(**v) for name, v in json.loads(path.read_text()).items()})
    facts = {
        "command": f"python -m benchmarks.missing_physics.sensors --seeds {options.seeds[0]} {options.seeds[1]}",
        "sizes": SIZES,
        "size_px": SIZE_PX,
        "episodes": EPISODES,
        "rates": scored(rows),
    }
    write_json(options.out, facts, sort_keys=False)


if __name__ == "__main__":
    main()
