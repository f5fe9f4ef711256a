"""repair: put right known faults of cameras and tool, as a diagnosis names them; physics can be judged afterwards."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from plop.artifacts.layouts import Recordings
from plop.errors import PlopError
from plop.pipeline.stage import Choice, Input, Inputs, Output, Stage, Summary
from plop.recordings.edits import Edits, pass_on
from plop.recordings.overview import overview
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.sensors.faults.clock_offset import ClockOffset
from plop.sensors.faults.library import Faults, frame_share, parse_faults
from plop.sensors.faults.tool import RobotClock, Tool
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Settings
from stages.common_inputs import recordings_input


@dataclass(frozen=True)
class RepairConfig(Settings):
    """Settings of `repair`; their defaults are written only here."""

    fault: Annotated[tuple[str, ...], COMMON] = ()
    """Fault to put right: NAME.PARAMETER=VALUE@CAMERA, or NAME.PARAMETER=VALUE of the tool, as `diagnose` prints it."""
    jobs: Jobs = ALL_CORES
    """Episodes at a time, each in a process; -1 is one a core."""


def run(inputs: Inputs, config: RepairConfig, out: Output) -> Summary:
    """Write the recording set again, with poses, depth, and tool as they are without the faults.

    Raises:
        PlopError: See `check` and `check_inputs`.
    """
    check(config, {})
    check_inputs(inputs, config)
    given = inputs["recordings"].path
    recordings = RecordingSet.load(given)
    out.map(recordings.names, partial(_episode, recordings, config.fault), jobs=config.jobs)
    if Recordings(given).verdicts.is_file():
        shutil.copyfile(Recordings(given).verdicts, Recordings(out.path).verdicts)
    repaired = replace(recordings, folder=out.path)
    repaired.save()
    return Summary(*overview(repaired))


def check(config: RepairConfig, given: object) -> None:
    """Refuse to repair nothing.

    Raises:
        PlopError: No fault is named.
    """
    if not config.fault:
        raise PlopError(
            "No fault is named.",
            where="--fault",
            expected="NAME.PARAMETER=VALUE@CAMERA, or NAME.PARAMETER=VALUE of the tool, once or more",
            found="none",
            fix="`plop diagnose` prints the faults that it finds; see docs/how-to/repair-cameras.md.",
        )


def check_inputs(inputs: Inputs, config: RepairConfig) -> None:
    """Refuse faults that cannot be put right in these recordings.

    Raises:
        PlopError: A fault cannot be read, names a camera that the recordings lack, is a camera's clock, or was put
            right before.
    """
    _check_new(inputs["recordings"], config)
    recordings = RecordingSet.load(inputs["recordings"].path)
    for name in recordings.names[:1]:
        with recordings.open(name) as recording:
            faults = parse_faults(config.fault, recording.camera_names)
        late = [camera for camera in faults.by_camera if any(f.name == ClockOffset.name for f in faults.of(camera))]
        if late:
            raise PlopError(
                "The clock of a single camera cannot be put right: its images were taken at other times.",
                where=f"--fault {ClockOffset.name}",
                expected=f"a fault of pose, depth or tool; {RobotClock.name} where all cameras are late alike",
                found=f"the clock of {', '.join(late)}",
                fix=f"Leave it out: `plop diagnose --exclude {','.join(late)}`.",
            )


def _check_new(recordings: Input, config: RepairConfig) -> None:
    made = recordings.manifest
    if made is not None and made.stage == STAGE.name and set(made.config["fault"]) & set(config.fault):
        raise PlopError(
            "These recordings were repaired with this fault before.",
            where=recordings.path,
            expected="recordings with the fault",
            found=f"{made.address}, made with --fault {','.join(made.config['fault'])}",
            fix="Diagnose them, or name the recordings from before with --recordings.",
        )


def edits_of(recording: Recording, faults: Faults) -> Edits:
    """Give the edits that undo faults in one recording."""
    edits, frames = Edits(), len(recording)
    for name in faults.by_camera:
        poses = [recording.camera(name, k).world_from_cam for k in range(frames)]
        right = [faults.true_pose(name, frame_share(k, frames), pose) for k, pose in enumerate(poses)]
        edits.poses[f"cameras/{name}"] = np.stack(right)
        if any(fault.name.startswith("depth") for fault in faults.of(name)):
            edits.depth[f"cameras/{name}"] = partial(faults.true_depth, name)
    if faults.tool:
        mesh = recording.tool_mesh
        tool = faults.true_tool(Tool(recording.time_s, recording.world_from_tool, mesh.vertices, mesh.faces))
        edits.world_from_tool, edits.tool_vertices = tool.world_from_tool, tool.vertices
    return edits


def _episode(recordings: RecordingSet, typed: tuple[str, ...], name: str, out: Output) -> None:
    with recordings.open(name) as recording:
        edits = edits_of(recording, parse_faults(typed, recording.camera_names))
    pass_on(recordings.path(name), Recordings(out.path).episode(name), edits)


STAGE = Stage(
    name="repair",
    version=1,
    help="Put right known faults of cameras and tool, as `diagnose` names them.",
    config=RepairConfig,
    inputs={"recordings": recordings_input("recordings with the faults", Choice.UNAMBIGUOUS)},
    run=run,
    check=check,
    check_inputs=check_inputs,
)
