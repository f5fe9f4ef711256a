"""Layouts of the payloads: names of the files and folders of each stage, defined only here.

A payload's folder is the artifact's own (`Artifact.path`, `Input.path`, `Output.path`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plop.errors import PlopError


@dataclass(frozen=True)
class Payload:
    """Files below one folder."""

    folder: Path


class Recordings(Payload):
    """What `ingest`, `simulate` and `calibrate` write; read it by `plop.recordings.set.RecordingSet`."""

    @property
    def index(self) -> Path:
        """Environment, split and episodes that were left out."""
        return self.folder / "episodes.json"

    @property
    def verdicts(self) -> Path:
        """Verdict of `calibrate` on each camera."""
        return self.folder / "calibration.json"

    def episode(self, name: str) -> Path:
        """The recording of an episode (`plop.recordings.recording`)."""
        return self.folder / "episodes" / f"{name}.h5"

    def report(self, name: str) -> Path:
        """Report of `ingest droid` on an episode, used or left out."""
        return self.folder / "reports" / f"{name}.json"


class Clouds(Payload):
    """What `fuse` writes."""

    @property
    def facts(self) -> Path:
        """Points, size and views of each cloud, and episodes that were left out."""
        return self.folder / "fuse.json"

    def cloud(self, name: str) -> Path:
        """Points, normals and colours of an episode's object."""
        return self.folder / "clouds" / f"{name}.ply"


class Fit(Payload):
    """Gaussians of one episode at frame 0."""

    @property
    def object_splat(self) -> Path:
        """The object's."""
        return self.folder / "object.ply"

    @property
    def tool_splat(self) -> Path:
        """The tool's."""
        return self.folder / "tool.ply"

    @property
    def score(self) -> Path:
        """Scores, and warnings."""
        return self.folder / "fit.json"

    def picture(self, name: str) -> Path:
        """A picture, by its name."""
        return self.folder / f"{name}.png"

    def present(self, fix: str = "Run `plop fit-init` on the same recordings.", *, tool: bool = True) -> Fit:
        """Return the fit; PlopError with `fix` where the object, or the tool if it is needed, was not fitted."""
        for path in (self.object_splat, self.tool_splat)[: 1 + tool]:
            if not path.is_file():
                name = self.folder.name
                raise PlopError(
                    "An episode has no fitted Gaussians.",
                    where=path,
                    expected=f"a fit of {name}",
                    found="no file",
                    fix=fix,
                )
        return self


class Fits(Payload):
    """What `fit-init` writes."""

    @property
    def facts(self) -> Path:
        """Scores of all episodes, and those that were left out."""
        return self.folder / "fit.json"

    def episode(self, name: str) -> Fit:
        """One episode's fit."""
        return Fit(self.folder / name)


class Tracks(Payload):
    """What `filter` writes."""

    def states(self, name: str) -> Path:
        """Predicted and updated states of an episode (`plop.gaussians.trajectory`)."""
        return self.folder / f"{name}.h5"

    def innovation(self, name: str) -> Path:
        """Errors before and after the update, by frame and camera."""
        return self.folder / f"{name}.json"


class Model(Payload):
    """What `train`, `identify` and `augment` write; read it by `plop.models`."""

    @property
    def facts(self) -> Path:
        """Kind and settings of the model, and what it was made from."""
        return self.folder / "model.json"

    @property
    def weights(self) -> Path:
        """Of a learned model."""
        return self.folder / "model.safetensors"

    @property
    def log(self) -> Path:
        """One line a step of the training."""
        return self.folder / "log.jsonl"

    @property
    def board(self) -> Path:
        """The same for TensorBoard; it contains time stamps."""
        return self.folder / "tensorboard"

    @property
    def checkpoint(self) -> Path:
        """Checkpoint from which an interrupted training resumes; removed at its end."""
        return self.folder / "checkpoint.safetensors"

    @property
    def tracks(self) -> Tracks:
        """States of the training episodes, which the filter found, and their errors."""
        return Tracks(self.folder / "tracks")

    @property
    def made_up(self) -> Tracks:
        """States of simulated episodes, or why the engine could not simulate them."""
        return Tracks(self.folder / "made-up")

    @property
    def folds(self) -> Path:
        """Folder of the models trained without some of the episodes, by number."""
        return self.folder / "folds"

    @property
    def base(self) -> Model:
        """The model below an added effect."""
        return Model(self.folder / "base")

    @property
    def effects(self) -> Path:
        """Folder of the user's effect files that the model needs."""
        return self.folder / "effects"


class Rollout(Payload):
    """Prediction of one episode."""

    @property
    def states(self) -> Path:
        """Gaussians in every frame (`plop.gaussians.trajectory`)."""
        return self.folder / "states.h5"

    @property
    def images(self) -> Path:
        """Predicted images of each camera (`plop.render.view_file`)."""
        return self.folder / "images.h5"

    @property
    def video(self) -> Path:
        """Measured, predicted and their distance side by side."""
        return self.folder / "video.mp4"

    @property
    def still(self) -> Path:
        """The frame of the video where they differ most."""
        return self.folder / "still.png"

    def frame(self, number: int) -> Path:
        """A frame's Gaussians, if an animation was requested."""
        return self.folder / "animation" / f"frame_{number:05d}.ply"


class Rollouts(Payload):
    """What `rollout` writes."""

    def episode(self, name: str) -> Rollout:
        """One episode's prediction."""
        return Rollout(self.folder / name)

    def validation(self, name: str) -> Path:
        """Errors and spread in an episode that the band's width is from (`plop.uncertainty.errors`)."""
        return self.folder / "validation" / f"{name}.npz"

    @property
    def all(self) -> list[Rollout]:
        """All episodes by name."""
        return [Rollout(path.parent) for path in sorted(self.folder.glob("*/images.h5"))]


class ScoreFiles(Payload):
    """What `eval` writes."""

    @property
    def report(self) -> Path:
        """Scores of the environment and of each episode."""
        return self.folder / "scores.json"

    @property
    def table(self) -> Path:
        """Scores of each frame."""
        return self.folder / "scores.csv"

    @property
    def over_time(self) -> Path:
        """Picture of scores over time."""
        return self.folder / "over_time.png"

    @property
    def bands(self) -> Path:
        """Picture of the band over time."""
        return self.folder / "bands.png"

    def band_errors(self, name: str) -> Path:
        """Errors and spread of an episode's points (`plop.uncertainty.errors`)."""
        return self.folder / "bands" / f"{name}.npz"

    def rows(self, name: str) -> Path:
        """Scores of each frame of an episode."""
        return self.folder / "episodes" / f"{name}.json"

    def picture(self, name: str) -> Path:
        """First, middle and last frame of an episode."""
        return self.folder / "pictures" / f"{name}.png"

    @property
    def pictures(self) -> list[Path]:
        """The same of all episodes."""
        return sorted(self.folder.glob("pictures/*.png"))


class ComparisonFiles(Payload):
    """What `compare` writes."""

    @property
    def facts(self) -> Path:
        """Errors over episodes, phases, places and cameras."""
        return self.folder / "compare.json"

    def field(self, name: str) -> Path:
        """Errors of an episode's points (`plop.comparison.field_file`)."""
        return self.folder / "fields" / f"{name}.npz"

    @property
    def tables(self) -> Path:
        """Picture of the tables."""
        return self.folder / "pictures" / "tables.png"

    def over_time(self, name: str) -> Path:
        """Picture of an episode's error over time."""
        return self.folder / "pictures" / f"{name}_time.png"

    def on_object(self, name: str) -> Path:
        """Picture of an episode's error on the object."""
        return self.folder / "pictures" / f"{name}_object.png"


class Report(Payload):
    """What `report` writes."""

    @property
    def page(self) -> Path:
        """The page, which needs no other file."""
        return self.folder / "report.html"
