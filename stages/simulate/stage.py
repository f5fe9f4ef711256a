"""simulate: a soft object and a tool, with or without hidden effects, recorded by a ring of RGB-D cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from plop.artifacts.layouts import Recordings
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType, library
from plop.physics.hidden.choose import choose
from plop.physics.hidden.wish import Wish, parse_hidden
from plop.physics.scenes import find_scene
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.sealed import seal_answer
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.overview import overview
from plop.recordings.set import RecordingSet, check_patterns, split_names
from plop.render.virtual_cameras.recorder import Disturbances, record
from plop.render.virtual_cameras.rig import camera_names
from plop.render.virtual_cameras.settings import CameraSettings
from plop.sensors.faults.library import Faults, parse_faults
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Seed, Settings, Unit
from stages.simulate.droid import write_droid
from stages.simulate.pieces import Pieces

QUIET_FLOOR_M = 0.001
"""Noise floor where depth has no noise [m]."""


@dataclass(frozen=True)
class SimulateConfig(Settings):
    """Settings of `simulate`; their defaults are defined only here."""

    cameras: CameraSettings = CameraSettings(depth_noise_m=0.001)
    """Cameras, light and depth sensors."""
    hide: Annotated[tuple[str, ...], COMMON] = ()
    """Effect to hide: EFFECT=AMPLITUDE, EFFECT.PARAMETER=VALUE, or random."""
    snr: Annotated[float, Range(0, 1e6), COMMON] = 0.0
    """Signal-to-noise ratio to which each hidden effect is scaled: displacement (root mean square over surface, frames
    and episodes) over the noise floor, which is cameras.depth_noise_m. 0 keeps the given amplitudes."""
    fault: tuple[str, ...] = ()
    """Sensor fault: NAME=VALUE of the first camera, or NAME=VALUE@CAMERA; clock, pose_error, pose_drift,
    depth_scale, depth_bias. NAME=VALUE of the tool; robot_clock, tool_offset, tool_thickness."""
    episodes: Annotated[int, Range(0, 999), COMMON] = 0
    """Number of episodes; 0 uses the scene's."""
    motions: tuple[str, ...] = ()
    """Kinds of motion, in turn; none uses the scene's."""
    test: Annotated[tuple[str, ...], COMMON] = ()
    """Globs of the test episodes; empty selects the last quarter of the names, at least one."""
    colour_noise: Annotated[float, Range(0, 255)] = 2.0
    """Standard deviation of noise added to each colour channel, of 255."""
    arm_m: Annotated[float, Range(0, 0.999), Unit("m")] = 0.0
    """Width of an arm that holds the tool and hides part of each view; 0: no arm."""
    droid: bool = False
    """Also write the episodes as DROID raw episodes, below droid/."""
    seed: Annotated[Seed, COMMON] = 0
    """Seed of texture and noise; added to the scene's, also of motions and hidden effects."""
    motions_seed: Annotated[int, Range(-1)] = -1
    """Seed of the motions: the seed of other recordings repeats theirs; -1 takes `seed`."""
    jobs: Annotated[Jobs, COMMON] = ALL_CORES
    """Number of parallel processes, one episode each; -1 is one per core."""


def run(inputs: Inputs, config: SimulateConfig, out: Output) -> Summary:
    """Simulate and record every episode; seal the answer.

    Args:
        inputs: "scene", and perhaps "effect_file".
        config: Settings.
        out: Receives episodes/<name>.h5, episodes.json, answer/sealed.json and perhaps droid/.

    Raises:
        PlopError: An invalid scene, effect or fault, a tool that never touches, or an unstable run.
    """
    scene = read_scene(inputs["scene"].path, config)
    files = [inputs["effect_file"].path] if "effect_file" in inputs else []
    effects = library(files)
    wishes = parse_hidden(config.hide, effects)
    faults = parse_faults(config.fault, camera_names(config.cameras.count))
    pieces = Pieces(out, scene)
    unfit = check_patterns(pieces.names, config.test, option="--test", where=inputs["scene"].path)
    hidden = pieces.hidden(effects, lambda: _choose(inputs, scene, wishes, effects, config, out))
    work = partial(_episode, scene, {effect.name: effect.values for effect in hidden}, files, faults, config)
    out.map(pieces.names, work, jobs=config.jobs)
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


def read_scene(path: Path, config: SimulateConfig) -> Scene:
    """Read the scene, with the seed, the number of episodes and the motions of the settings."""
    scene = Scene.read(path)
    seed = config.seed if config.motions_seed < 0 else config.motions_seed
    episodes, motions = config.episodes or scene.episodes, config.motions or scene.motions
    return replace(scene, seed=scene.seed + seed, episodes=episodes, motions=motions)


def noise_floor_m(config: SimulateConfig) -> float:
    """Return the noise of a measured point [m]."""
    return config.cameras.depth_noise_m or QUIET_FLOOR_M


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
        seed=Scene.read(inputs["scene"].path).seed + config.seed,
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
    """Simulate and record one episode, and store the displacement caused by the hidden effects."""
    pieces, known = Pieces(out, scene), library(files)
    k, hidden = pieces.names.index(name), [known[key](**given) for key, given in values.items()]
    out.progress(0, 1, f"{name}: simulating")
    sequence = simulate_episode(scene, k, hidden)
    pieces.keep_response(k, sequence, hidden)
    disturbances = Disturbances(faults, config.colour_noise, config.arm_m)
    path = Recordings(out.path).episode(name)
    for share in record(path, sequence, config.cameras, disturbances, seed=config.seed):
        out.progress(share, 1, name)
    if config.droid:
        draft = pieces.folder / "droid" / name
        write_droid(out.path / "droid", draft, k, sequence, config.cameras, disturbances, seed=config.seed)


def _find_raw(name: str, path: Path) -> Path:
    return find_scene(path) if name == "scene" else path


STAGE = Stage(
    name="simulate",
    version=8,
    help="Simulate a scene (TOML) of a soft object and a tool, with or without hidden effects, into recordings.",
    config=SimulateConfig,
    inputs={
        "scene": InputSpec(
            (),
            "TOML file of the scene; a bare name selects a shipped one: block.toml, quick-block.toml, sphere.toml, "
            "cylinder.toml.",
        ),
        "effect_file": InputSpec((), "Python file with effects of your own.", optional=True),
    },
    run=run,
    find_raw=_find_raw,
)
