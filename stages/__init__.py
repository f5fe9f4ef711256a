"""The pipeline, in order: start reading here.

Each line is a command, the module of its stage, and its purpose. A stage is imported when
it is run, so that `plop --help` answers immediately. A stage declares its inputs in `inputs`:
`plop.pipeline` reads the graph from there, and runs the stages of this list.
"""

from __future__ import annotations

from plop.pipeline.registry import StageRef

PIPELINE = (
    StageRef("simulate", "stages.simulate.stage:STAGE", "Simulate a soft object and a tool into recordings."),
    StageRef("ingest disect", "stages.ingest.stage:INGEST_DISECT", "Render DiSECt simulations into recordings."),
    StageRef("ingest mesh", "stages.ingest.stage:INGEST_MESH", "Render mesh sequences of a simulator into recordings."),
    StageRef("ingest droid", "stages.ingest.droid:INGEST_DROID", "Convert episodes of a DROID robot to recordings."),
    StageRef("calibrate", "stages.calibrate.stage:STAGE", "Find and check camera calibration; a verdict per camera."),
    StageRef("repair", "stages.repair.stage:STAGE", "Put right known faults of cameras and tool."),
    StageRef("fuse", "stages.fuse.stage:STAGE", "Fuse the views before the cut into one object cloud."),
    StageRef("fit-init", "stages.fit_init.stage:STAGE", "Fit 3D Gaussians to the first frame: object and tool."),
    StageRef("train", "stages.train.stage:STAGE", "Learn the dynamics from the training episodes."),
    StageRef("filter", "stages.filter.stage:STAGE", "Track the object through an episode: predict and update."),
    StageRef("identify", "stages.identify.stage:STAGE", "Fit the engine's material to recordings: a physics model."),
    StageRef("rollout", "stages.rollout.stage:STAGE", "Predict unseen episodes from their first frame and actions."),
    StageRef("eval", "stages.eval.stage:STAGE", "Score predictions against measurements and two baselines."),
    StageRef("compare", "stages.compare.stage:STAGE", "Compare a model with measurements: where and when it fails."),
    StageRef("diagnose", "stages.diagnose.stage:STAGE", "Name the physical effect that a model is missing."),
    StageRef("plan", "stages.plan.stage:STAGE", "Plan recordings: what would be seen, what distinguishes laws."),
    StageRef("augment", "stages.augment.stage:STAGE", "Add an effect to a model; reversible."),
    StageRef("report", "stages.report.stage:STAGE", "Write one HTML file with all results."),
)

RECORDINGS = ("calibrate", "ingest", "simulate", "repair")
"""Stages whose artifacts are recordings; the first makes what is missing."""
MODELS = ("train", "identify", "augment")
"""Stages whose artifacts are models."""
NEXT = {
    "simulate": "fuse",  # simulated cameras are correct
    "ingest": "calibrate",
    "calibrate": "fuse",
    "repair": "diagnose",
    "fuse": "fit-init",
    "fit-init": "train",
    "train": "rollout",
    "filter": "identify",
    "identify": "compare",
    "rollout": "eval",
    "eval": "compare",
    "compare": "diagnose",
    "diagnose": "augment",
    "augment": "report",
}
"""Advice, not the graph: the usual next stage. Each uses the artifact of the one before, or scores it."""
