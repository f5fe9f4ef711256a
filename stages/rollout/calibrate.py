"""Choose the width of the band: roll all models out on the validation episodes and compare with their tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from plop.artifacts.layouts import Fits, Model, Rollouts
from plop.compute.device import chosen_device, jobs_on
from plop.dynamics.i2n.model_io import read_facts
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.models import device_of, load_model
from plop.pipeline.stage import Inputs, Output
from plop.recordings.set import RecordingSet
from plop.tracking.episode import Episode
from plop.uncertainty.band import LEVEL, Band, calibrated
from plop.uncertainty.conformal import least_groups
from plop.uncertainty.errors import PointErrors, point_errors
from stages.common_inputs import measured_episodes
from stages.rollout.episode import predicted

if TYPE_CHECKING:
    from stages.rollout.stage import RolloutConfig


def model_folders(inputs: Inputs) -> list[Path]:
    """Return the folder of the model, and those of the members after it.

    Raises:
        PlopError: The model is one of its own members.
    """
    count = sum(name.startswith("members.") for name in inputs)
    folders = [inputs["model"].path, *(inputs[f"members.{k}"].path for k in range(count))]
    if len(set(folders)) < len(folders):
        raise PlopError(
            "A model is a member twice.",
            where="rollout.members",
            expected="models besides rollout.model, each once",
            found=", ".join(path.name for path in folders),
            fix="Name the other models only: `--model a --members b,c`.",
        )
    return folders


def check_members(inputs: Inputs, config: RolloutConfig) -> None:
    """Refuse models that give no band before their episodes are tracked.

    Raises:
        PlopError: One is named twice, or no episode was held out of the training of every model.
    """
    folders = model_folders(inputs)
    if len(folders) > 1:
        _validation(folders, RecordingSet.load(inputs["recordings"].path))


def calibrate(
    inputs: Inputs, recordings: RecordingSet, folders: Sequence[Path], config: RolloutConfig, out: Output
) -> tuple[Band, list[str]]:
    """Choose the band's width, and write it and the errors that it is from.

    Returns:
        The band, and warnings.

    Raises:
        PlopError: No episode was held out of the training of every model, or none has a track.
    """
    init = inputs["init"].path
    episodes, left_out = measured_episodes(inputs, recordings, _validation(folders, recordings))
    known = {episode.name: episode for episode in episodes}
    work = partial(_compare, recordings, list(folders), init, config, known)
    out.map(list(known), work, jobs=jobs_on(config.device, config.jobs), of="validation")
    errors = [PointErrors.read(Rollouts(out.path).validation(name)) for name in known]
    band = calibrated(errors, len(folders))
    band.write(out.path)
    warnings = [f"{name} is left out of the band's calibration: {why}" for name, why in left_out.items()]
    if not band.guaranteed:
        warnings.append(
            f"{len(known)} validation episode(s) cannot guarantee that the band holds {LEVEL:.0%} of the points: "
            f"at least {least_groups(LEVEL)} are needed (train.validation); its factor is an estimate"
        )
    if not any(np.any(each.spread_m > 0) for each in errors):
        warnings.append("all models predict the same, so the band is as wide everywhere: train with different seeds")
    return band, warnings


def _validation(folders: Sequence[Path], recordings: RecordingSet) -> list[str]:
    """Return the episodes that every model held out of its training."""
    held = [read_facts(folder).get("training", {}).get("validation", []) for folder in folders]
    names = [name for name in recordings.train if all(name in each for each in held)]
    if not names:
        raise PlopError(
            "There is no validation episode to choose the width of the band from.",
            where=Model(folders[0]).facts,
            expected="episodes of these recordings that no model was trained on",
            found="; ".join(", ".join(each) or "none" for each in held),
            fix=f"Train every model with --set train.validation={least_groups(LEVEL)} or more, on these recordings.",
        )
    return names


def _compare(
    recordings: RecordingSet,
    folders: list[Path],
    init: Path,
    config: RolloutConfig,
    episodes: Mapping[str, Episode],
    name: str,
    out: Output,
) -> None:
    models = [load_model(folder, chosen_device(config.device)) for folder in folders]
    start = read_splat(Fits(init).episode(name).object_splat).to(device_of(models[0]))
    with recordings.open(name) as recording:
        frames = predicted(models, recording, start, config.seed)
        each = ((state.gaussians, spread) for state, _, spread in frames if spread is not None)
        point_errors(episodes[name], each).write(Rollouts(out.path).validation(name))
