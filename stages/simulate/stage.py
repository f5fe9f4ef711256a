"""simulate: a soft object and a tool, with or without hidden effects, recorded by a ring of RGB-D cameras."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from plop.checked_settings import check_jobs, check_ranges
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType, library
from plop.physics.scenes import find_scene
from plop.physics.scenes.hidden import choose
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.sealed import seal_answer
from plop.physics.scenes.wish import Wish, parse_hidden
from plop.pipeline.parallel import every_piece
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary, settings_only
from plop.recordings.overview import overview
from plop.recordings.set import RecordingSet, check_patterns, split_names
from plop.render.recorder import Disturbances, record
from plop.render.rig import camera_names
from plop.render.settings import CameraSettings, check_cameras
from plop.sensors.faults import Faults, parse_faults
from stages.simulate.droid import write_droid
from stages.simulate.pieces import Pieces

QUIET_FLOOR_M = 0.001
"""Noise floor where depth has no noise [m]."""


@dataclass(frozen=True)
class SimulateConfig(CameraSettings):
    """Settings of `simulate`, besides those of the cameras."""

    hide: tuple[str, ...] = ()
    """Effect to hide: EFFECT=AMPLITUDE, EFFECT.PARAMETER=VALUE, or random."""
    snr: float = 0.0
    """Scale each hidden effect so that it moves the object by so many times the noise floor (root mean square
    over surface, frames and episodes); the floor is depth_noise_m. 0 leaves given amplitudes as they are."""
    fault: tuple[str, ...] = ()
    """Sensor fault: NAME=VALUE of the first camera, or NAME=VALUE@CAMERA; clock, pose_error, pose_drift,
    depth_scale, depth_bias."""
    episodes: int = 0
    """Number of episodes; 0 takes the scene's."""
    test: tuple[str, ...] = ()
    """Globs of the episodes kept for the test; none keeps the last quarter of the names, at least one."""
    depth_noise_m: float = 0.001
    """Standard deviation of noise added to depth [m]."""
    colour_noise: float = 2.0
    """Standard deviation of noise added to each colour channel, of 255 [-]."""
    arm_m: float = 0.0
    """Width of an arm that holds the tool and hides part of each view [m]; 0 leaves it out."""
    droid: bool = False
    """Write the episodes as DROID raw episodes, too, below droid/."""
    seed: int = 0
    """Seed of texture and noise; added to the scene's, it draws motions and hidden effects."""
    jobs: int = field(default=-1, metadata={"in_fingerprint": False})
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: SimulateConfig, out: Output) -> Summary:
    """Simulate and record every episode; seal the answer.

    Args:
        inputs: "scene", and perhaps "effect_file".
        config: Settings.
        out: Receives episodes/<name>.h5, episodes.json, answer/sealed.json and perhaps droid/.

    Raises:
        PlopError: A scene, effect or fault that cannot be used, a tool that never touches, or an unstable run.
    """
    _check(config)
    scene = read_scene(inputs["scene"].path, config)
    files = [inputs["effect_file"].path] if "effect_file" in inputs else []
    effects = library(files)
    wishes = parse_hidden(config.hide, effects)
    faults = parse_faults(config.fault, camera_names(config.cameras))
    pieces = Pieces(out, scene)
    unfit = check_patterns(pieces.names, config.test, option="--test", where=inputs["scene"].path)
    hidden = pieces.hidden(effects, lambda: _choose(inputs, scene, wishes, effects, config, out))
    work = partial(_episode, scene, {effect.name: effect.values for effect in hidden}, files, faults, config)
    every_piece(work, pieces.names, out, jobs=config.jobs)
    recordings = RecordingSet(out.path, scene.name, *split_names(pieces.names, config.test))
    recordings.save()
    rms, floor = pieces.rms_m(), noise_floor_m(config)
    seal_answer(
        out.path,
        {
            "effects": {effect.name: dict(effect.values) for effect in hidden},
            "faults": faults.as_dict(),
            "random": any(wish.effect is None for wish in wishes),
            "rms_m": rms,
            "noise_floor_m": floor,
            "snr": rms / floor,
        },
    )
    figures, table, warnings = overview(recordings)
    rows = [{**row, "motion": scene.motion_plan(pieces.names.index(row["episode"])).kind} for row in table]
    return Summary(figures=figures, table=rows, warnings=unfit + warnings)


def _check(config: SimulateConfig) -> None:
    check_jobs(config, "simulate")
    check_cameras(config, "simulate")
    check_ranges(
        config, "simulate", {"snr": (0, 1e6), "episodes": (0, 999), "colour_noise": (0, 255), "arm_m": (0, 0.999)}
    )


def read_scene(path: Path, config: SimulateConfig) -> Scene:
    """Read the scene, with the seed and the number of episodes that the settings ask for."""
    scene = Scene.read(path)
    return replace(scene, seed=scene.seed + config.seed, episodes=config.episodes or scene.episodes)


def noise_floor_m(config: SimulateConfig) -> float:
    """Give what counts as noise of a measured point [m]."""
    return config.depth_noise_m or QUIET_FLOOR_M


def _choose(
    inputs: Inputs,
    scene: Scene,
    wishes: list[Wish],
    effects: dict[str, EffectType],
    config: SimulateConfig,
    out: Output,
) -> list[Effect]:
    return choose(
        scene,
        wishes,
        snr=config.snr,
        noise_floor_m=noise_floor_m(config),
        effects=effects,
        jobs=1 if "effect_file" in inputs else config.jobs,
        progress=lambda share: out.progress(0, scene.episodes, f"amplitude {share:.0%}"),
    )


def _episode(
    scene: Scene,
    values: dict[str, dict[str, float]],
    files: list[Path],
    faults: Faults,
    config: SimulateConfig,
    name: str,
    out: Output,
) -> None:
    """Simulate and record one episode, and keep how far the hidden effects, given by their values, moved it."""
    pieces, known = Pieces(out, scene), library(files)
    k, hidden = pieces.names.index(name), [known[key](**given) for key, given in values.items()]
    out.progress(0, 1, f"{name}: simulating")
    sequence = simulate_episode(scene, k, hidden)
    pieces.keep_response(k, sequence, hidden)
    disturbances = Disturbances(faults, config.colour_noise, config.arm_m)
    for share in record(out.path / "episodes" / f"{name}.h5", sequence, config, disturbances):
        out.progress(share, 1, name)
    if config.droid:
        write_droid(out.path / "droid", pieces.folder / "droid" / name, k, sequence, config, disturbances)


def _find_raw(name: str, path: Path) -> Path:
    return find_scene(path) if name == "scene" else path


STAGE = Stage(
    name="simulate",
    version=4,
    help="Simulate a scene (TOML) of a soft object and a tool, with or without hidden effects, into recordings.",
    config=SimulateConfig,
    inputs={
        "scene": InputSpec(
            (), "TOML file of the scene; a bare name takes a shipped one: block.toml, sphere.toml, cylinder.toml."
        ),
        "effect_file": InputSpec((), "Python file with effects of your own.", optional=True),
    },
    run=run,
    check=settings_only(_check),
    find_raw=_find_raw,
)
