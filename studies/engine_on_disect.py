"""How well the particle-grid engine follows another simulator's recordings, before and after calibration.

`python -m studies.engine_on_disect --data <folder with the DiSECt recordings> [ENVIRONMENT ...]`
calibrates on part recordings 000-003 of each environment, scores on 004 and 005, and writes
docs/results/engine_disect.json (merged with what is there).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from plop.geometry.rigid import transform_points
from plop.metrics.chamfer import cd_mm, nearest_distances
from plop.metrics.emd import emd_mm
from plop.physics.calibration.gauss_newton import Calibration, calibrate
from plop.physics.calibration.recorded_motion import Case, case_from_sequence, sides_of_parts
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.fill import surface_parts
from plop.physics.engine.material import Material
from plop.physics.engine.tool_motion import ToolKind, ToolShape
from plop.pipeline.execute import versions
from plop.recordings.readers.disect.episode import read_disect
from plop.recordings.readers.mesh.sequence import MeshSequence

RESULT = Path(__file__).resolve().parent.parent / "docs" / "results" / "engine_disect.json"
NAMES = ["youngs_modulus_pa", "viscosity_pa_s", "table_friction", "table_slip_m_s"]
"""What is fitted; the tool's friction is taken as stated, and there is no drag: the other simulator has none."""
ENVIRONMENTS = ["prism_jelly", "prism_foam", "cylinder_jelly", "cylinder_foam"]
G = (0.0, 0.0, -9.80665)
FIT_SPACING_M, SCORE_SPACING_M, EMD_POINTS = 0.00715, 0.005, 512
START_SLIP_M_S = 0.005
"""Where the fit of the speed begins up to which the table rubs in proportion to it."""


def config(spacing_m: float) -> EngineConfig:
    """Twice the particles' spacing as grid; the other simulator's square friction cone."""
    return EngineConfig(dx_m=2 * spacing_m, gravity_m_s2=G, table_cone="pyramid")


def declared_material(sequence: MeshSequence) -> Material:
    """The parameters that the recording's own file states, taken at their word."""
    stated, settings = sequence.facts["material_parameters"], sequence.facts["settings"]
    return Material(
        youngs_modulus_pa=stated["young"],
        poisson=stated["poisson"],
        density_kg_m3=stated["density"],
        viscosity_pa_s=stated["damping"],
        table_friction=settings["ground_mu"],
        tool_friction=settings["sdf_mu"],
    )


def thin_out(case: Case, every: int) -> Case:
    """Compare every n-th point only."""
    material, count = case.tracers.start, case.observed.shape[1]
    keep = np.r_[np.arange(material), material + np.arange(0, count, every)]
    return replace(case, particles=case.particles.select(keep), observed=case.observed[:, ::every])


def score(case: Case, sequence: MeshSequence, material: Material, spacing_m: float) -> dict[str, float]:
    """RMS, Chamfer and earth mover's distance of the surface's vertices, mm; at the end of cut and push."""
    predicted = case.predict(material, config(spacing_m))
    error = np.sqrt(((predicted - case.observed) ** 2).sum(-1).mean(1)) * 1e3
    motion = np.sqrt(((case.observed[-1] - sequence.rest) ** 2).sum(-1).mean()) * 1e3
    draw = np.random.default_rng(0).choice(len(sequence.rest), EMD_POINTS, replace=False)
    return {
        "rms_end_mm": float(error[-1]),
        "rms_cut_end_mm": float(error[int(sequence.facts["frames_cut"]) - 1]),
        "rms_mean_mm": float(error.mean()),
        "cd_end_mm": cd_mm(nearest_distances(predicted[-1], case.observed[-1])) or 0.0,
        "emd_end_mm": emd_mm(predicted[-1][draw], case.observed[-1][draw]) or 0.0,
        "motion_rms_mm": float(motion),
    }


def measure(data: Path, environment: str, iterations: int) -> dict[str, object]:
    """Calibrate one environment and score its test recordings."""
    sequences = [read_disect(data / f"{environment}_part_{k:03d}.usd") for k in range(6)]
    declared = declared_material(sequences[0])
    start = replace(declared, table_slip_m_s=START_SLIP_M_S)
    cases = [thin_out(case_from_sequence(s, FIT_SPACING_M), 3) for s in sequences[:4]]
    began = time.process_time()
    fit = calibrate(
        cases,
        start,
        NAMES,
        config(FIT_SPACING_M),
        iterations=iterations,
        progress=lambda k, n, rms: _say(f"{environment}: step {k}/{n}, rms {rms * 1e3:.3f} mm"),
    )
    seconds = time.process_time() - began
    scores: dict[str, dict[str, dict[str, float]]] = {}
    for label, material in (("stated", declared), ("calibrated", fit.material)):
        for spacing in (FIT_SPACING_M, SCORE_SPACING_M):
            key = f"{label}_{spacing * 1e3:g}mm"
            scores[key] = {s.name: score(case_from_sequence(s, spacing), s, material, spacing) for s in sequences[4:]}
            _say(f"{environment} {key}: " + ", ".join(f"{v['rms_end_mm']:.2f}" for v in scores[key].values()) + " mm")
    faults = {s.name: points_on_wrong_side(s) for s in sequences}
    return {"fit": summary(fit), "fit_cpu_seconds": seconds, "scores": scores, "points_on_wrong_side": faults}


def points_on_wrong_side(sequence: MeshSequence) -> int:
    """Count vertices that the other simulator left beyond the blade after the cut: there the blade hooks a half."""
    parts = surface_parts(sequence.faces, len(sequence.rest))
    sides = sides_of_parts(sequence, parts)[parts]
    shape = ToolShape.from_mesh(sequence.tool_vertices, sequence.tool_faces, ToolKind.BLADE)
    blade = np.linalg.inv(sequence.world_from_tool[-1])
    local = (transform_points(blade, sequence.vertices[-1]) - shape.center) @ shape.axes
    inside = (local[:, 1:] @ shape.faces[:, 1:3].T <= shape.faces[:, 3]).all(1)
    return int((inside & (sides * local[:, 0] < 0)).sum())


def summary(fit: Calibration) -> dict[str, object]:
    """Keep what a page of results shows."""
    return {
        "rms_before_mm": fit.rms_before_m * 1e3,
        "rms_after_mm": fit.rms_after_m * 1e3,
        "rollouts": fit.rollouts,
        "iterations": fit.iterations,
        "parameters": {k: asdict(v) for k, v in fit.estimates.items()},
    }


def main() -> None:
    """Measure the environments that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environments", nargs="*", default=ENVIRONMENTS, metavar="ENVIRONMENT")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    for environment in options.environments:
        entry = measure(options.data, environment, options.iterations)
        known = json.loads(options.out.read_text()) if options.out.exists() else {"environments": {}}
        known["command"] = "python -m studies.engine_on_disect --data <DiSECt recordings>"
        known["versions"] = versions()
        known["environments"][environment] = entry
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(_finite(known), indent=1, sort_keys=True) + "\n")


def _finite(value: object) -> object:
    """Replace infinities, which JSON does not know, by null."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    main()
