"""Measure how well sensor faults are found: `python -m studies.sensor_faults`.

Writes docs/results/sensors.json.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.missing_physics.score import wilson
from plop.physics.scenes.demo import demo_episode, draw_plan
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.estimation.estimate import estimate_sensors
from plop.sensors.estimation.finding import SensorFinding
from plop.sensors.faults.clock_offset import ClockOffset
from plop.sensors.faults.depth_bias import DepthBias
from plop.sensors.faults.depth_scale import DepthScale
from plop.sensors.faults.fault import Fault
from plop.sensors.faults.library import FAULTS, Faults
from plop.sensors.faults.pose_drift import PoseDrift
from plop.sensors.faults.pose_error import PoseError

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "sensors.json"


def episode(index: int, seed: int = 0) -> MeshSequence:
    """Simulate one cut and push of the demo."""
    return demo_episode(f"sensors_{index:03d}", draw_plan(np.random.default_rng([seed, index])))


def film(path: Path, sequence: MeshSequence, faults: Faults, *, seed: int = 0, **settings: float) -> Path:
    """Film one episode with the cameras of `plop ingest mesh`; `settings` are those of CameraSettings."""
    cameras = CameraSettings(**{"supersample": 1, **settings})  # type: ignore[arg-type]
    for _ in record(path, sequence, cameras, Disturbances(faults), seed=seed):
        pass
    return path


KINDS = ("clock", "depth_scale", "depth_bias", "drift_m", "drift_deg", "pose_error")
AMPLITUDE = {
    "clock": 0.02,
    "depth_scale": 0.01,
    "depth_bias": 0.003,
    "drift_m": 0.003,
    "drift_deg": 0.5,
    "pose_error": 0.003,
}
NOISES_M = (0.0005, 0.001, 0.002)


def draw_fault(kind: str, share: float, generator: np.random.Generator) -> tuple[str, list[Fault]]:
    """Draw a fault of the benchmark with random sign or direction; gives its library name and the law."""
    size, sign = share * AMPLITUDE[kind], float(generator.choice([-1, 1]))
    direction = generator.normal(size=3)
    direction /= np.linalg.norm(direction)
    if kind == "clock":
        return kind, [ClockOffset(offset_s=sign * size)]
    if kind == "depth_scale":
        return kind, [DepthScale(factor=1 + sign * size)]
    if kind == "depth_bias":
        return kind, [DepthBias(offset_m=sign * size)]
    law = PoseError if kind == "pose_error" else PoseDrift
    keys = ("rx_rad", "ry_rad", "rz_rad") if kind == "drift_deg" else ("x_m", "y_m", "z_m")
    size = np.radians(size) if kind == "drift_deg" else size
    return law.name, [law(**dict(zip(keys, (size * direction).tolist(), strict=True)))]


@dataclass
class Tally:
    """What happened to the cameras of one kind."""

    cameras: int = 0
    found: int = 0
    others: int = 0
    """Cameras on which another fault was (also) found."""
    wrong: dict[str, list[float]] = field(default_factory=dict)
    """The other faults that were found, and how much they would move the object [m]."""
    ambiguous: int = 0
    """Found, with another fault named as an equally good explanation."""
    errors: list[float] = field(default_factory=list)
    """Error of the amplitude: length of (found - true) over length of the true parameters."""
    scores: list[float] = field(default_factory=list)
    """(found - true) / standard error, every parameter."""

    def add(self, finding: SensorFinding, name: str, truth: Fault | None) -> None:
        """Count one camera."""
        self.cameras += 1
        self.count_others(finding, {name})
        for each in finding.faults:
            true = FAULTS[each.fault]() if truth is None or each.fault != name else truth
            if truth is None or each.fault == name:
                self.scores += [(each.values[k] - true[k]) / each.standard_errors[k] for k in each.values]
            if each.fault == name and truth is not None and each.found:
                self.found += 1
                self.ambiguous += bool(each.alternatives)
                absent = FAULTS[name]()
                used = [k for k in each.values if true[k] != absent[k]]
                wrong = np.array([each.values[k] - true[k] for k in used])
                self.errors.append(float(np.linalg.norm(wrong) / np.linalg.norm([true[k] - absent[k] for k in used])))

    def count_others(self, finding: SensorFinding, names: set[str]) -> None:
        """Count a camera on which other faults than these were found."""
        others = [each for each in finding.found if each.fault not in names]
        self.others += bool(others)
        for each in others:
            self.wrong.setdefault(each.fault, []).append(round(each.effect_m, 6))

    def row(self) -> dict[str, object]:
        """Give the figures, rates with Wilson's 95 % interval."""
        scores = np.abs(self.scores)
        return {
            "cameras": self.cameras,
            "found": wilson(self.found, self.cameras),
            "another_found": wilson(self.others, self.cameras),
            "another_m": self.wrong,
            "ambiguous": self.ambiguous,
            "median_error": round(float(np.median(self.errors)), 4) if self.errors else None,
            "within_1_96_se": round(float((scores < 1.96).mean()), 3) if len(scores) else None,
        }


def measure(
    recordings: int,
    share: float,
    folder: Path,
    sequences: list[MeshSequence],
    kinds: tuple[tuple[str, ...], ...],
    seed: int,
    size_px: int = 128,
) -> dict[str, Tally]:
    """Film `recordings` episodes, camera c of recording r with the faults kinds[(c + r) % len(kinds)]."""
    tallies: dict[str, Tally] = {}
    for r in range(recordings):
        generator = np.random.default_rng([seed, r])
        sequence = sequences[r % len(sequences)]
        drawn = {
            f"cam_{i:02d}": [draw_fault(kind, share, generator) for kind in kinds[(i + r) % len(kinds)]]
            for i in range(6)
        }
        faults = Faults({name: [law for _, laws in each for law in laws] for name, each in drawn.items()})
        path = film(
            folder / "episode.h5",
            sequence,
            faults,
            depth_noise_m=NOISES_M[r % 3],
            seed=seed + r,
            size=size_px,
            azimuth_deg=float(generator.uniform(0, 60)),
        )
        for i, finding in enumerate(estimate_sensors(path)):
            label = "+".join(kinds[(i + r) % len(kinds)]) or "none"
            tally = tallies.setdefault(label, Tally())
            truth = drawn[finding.camera]
            if len(truth) < 2:
                tally.add(finding, truth[0][0] if truth else "", truth[0][1][0] if truth else None)
            else:
                names = {name for name, _ in truth}
                tally.cameras += 1
                tally.found += {each.fault for each in finding.found} >= names
                tally.count_others(finding, names)
    return tallies


PAIRS = (
    ("clock", "depth_bias"),
    ("depth_scale", "depth_bias"),
    ("depth_bias", "pose_error"),
    ("depth_scale", "pose_error"),
    ("clock", "drift_m"),
    ("drift_deg", "pose_error"),
)


def main() -> int:
    """Measure everything and write the result file."""
    parser = argparse.ArgumentParser(prog="python -m studies.sensor_faults", description=__doc__)
    parser.add_argument("--recordings", type=int, default=9, help="recordings of six cameras in each set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    singles = tuple((kind,) for kind in KINDS)
    sets = {
        "null": (1.0, ((),), 128),
        "single": (1.0, singles, 128),
        "pairs": (1.0, PAIRS, 128),
        "quarter_amplitude": (0.25, singles, 128),
        "null_64px": (1.0, ((),), 64),
    }
    result: dict[str, object] = {
        "command": "python -m studies.sensor_faults",
        "seed": options.seed,
        "amplitudes": AMPLITUDE,
        "noises_m": NOISES_M,
    }
    sequences = [episode(k, options.seed) for k in range(6)]
    with tempfile.TemporaryDirectory() as folder:
        path = film(Path(folder) / "speed.h5", sequences[0], Faults({}), depth_noise_m=0.001)
        started = time.process_time()
        estimate_sensors(path)
        result["cpu_s_per_episode"] = round(time.process_time() - started, 2)
        result["frames_per_episode"] = len(sequences[0])
        for number, (name, (share, kinds, size)) in enumerate(sets.items()):
            tallies = measure(
                options.recordings, share, Path(folder), sequences, kinds, 1000 * (number + 1) + options.seed, size
            )
            result[name] = {kind: tally.row() for kind, tally in sorted(tallies.items())}
            print(name, json.dumps(result[name], indent=1), flush=True)
            options.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    options.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
