"""calibrate: a verdict per camera, with the fix, before anyone trains; corrected recordings pass on."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Recordings
from plop.errors import PlopError, remembering
from plop.geometry.calibration.boards import BoardKind
from plop.pipeline.stage import Inputs, InputSpec, Output, Stage, Summary
from plop.recordings.edits import Edits, pass_on
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from plop.setting_kinds import ALL_CORES, COMMON, Jobs, Range, Settings, Unit
from stages.calibrate.episode import calibrate_episode
from stages.calibrate.handeye_held import contradicted
from stages.calibrate.handeye_solve import NO_COLUMNS
from stages.calibrate.solved import Solved, board_of, edits_for, solve
from stages.calibrate.verdict import ORDER, check_usable


@dataclass(frozen=True)
class CalibrateConfig(Settings):
    """Settings of `calibrate`; their defaults are written only here."""

    correct: Annotated[bool, COMMON] = True
    """Whether cameras that disagree are corrected (pose, depth scale, time offset) or only reported."""
    check_frames: Annotated[int, Range(1), Unit("frames")] = 3
    """Frames of each episode, evenly spread, on which the cameras are compared."""
    region_margin_m: Annotated[float, Range(0, 10), Unit("m")] = 0.05
    """How far around the object surfaces are compared."""
    max_disagreement_mm: Annotated[float, Range(1e-6), Unit("mm"), COMMON] = 2.0
    """Depth disagreement with the other cameras, over what noise gives, that is still good."""
    max_table_mm: Annotated[float, Range(1e-6), Unit("mm"), COMMON] = 8.0
    """How far from table_z a camera may see the table under the object: a real table is tilted by up to 1 deg,
    some mm over a workspace, and table_z is measured by hand."""
    max_table_deg: Annotated[float, Range(1e-6, 90), Unit("deg")] = 2.5
    """How much tilted a camera may see the table: 1 deg of table and 1 deg of pose, and what noise adds."""
    max_reprojection_px: Annotated[float, Range(1e-6), Unit("px")] = 0.5
    """Reprojection error of board images that is still good."""
    max_offset_ms: Annotated[float, Range(0), Unit("ms")] = 15.0
    """Camera-to-robot time offset that is still good."""
    time_offset: Annotated[bool, COMMON] = True
    """Whether the time offset is measured from the tool's outline in the images."""
    max_offset_search_ms: Annotated[float, Range(0), Unit("ms")] = 200.0
    """Time offsets are searched up to this."""
    gate_m: Annotated[float, Range(1e-6), Unit("m")] = 0.03
    """Largest distance of corresponding points when cameras are registered to each other."""
    board_kind: Annotated[BoardKind, COMMON] = "charuco"
    """Board in `board_images` and in hand-eye images; "marker" is for hand-eye images only."""
    board_columns: Annotated[int, Range(2), Unit("squares"), COMMON] = 5
    """Along x; a chessboard has one inner corner fewer."""
    board_rows: Annotated[int, Range(2), Unit("squares"), COMMON] = 7
    """Along y."""
    board_square_m: Annotated[float, Range(1e-6, 1), Unit("m"), COMMON] = 0.034
    """Edge of a square, or of the single marker."""
    board_marker_m: Annotated[float, Range(0, 1), Unit("m"), COMMON] = 0.028
    """Edge of the markers in a ChArUco board."""
    board_dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the ArUco dictionary."""
    board_marker_id: Annotated[int, Range(0)] = 0
    """Id of the single marker."""
    hand_eye_method: Literal["auto", "TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"] = "auto"
    """Solver of hand-eye calibration; "auto" tries all and keeps the most consistent."""
    handeye_mount: Literal["auto", "wrist", "fixed"] = "auto"
    """Where the hand-eye cameras are: "wrist" (on the gripper), "fixed" (the board is in the gripper), or "auto": as
    each camera's files say, "wrist" where they say nothing."""
    fit_board_scale: bool = False
    """Whether board distances are multiplied by the factor that fits the robot's motion, where it is not 1 (the board
    is not of the size told)."""
    flange_from_tool: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Pose of the tool in the gripper of the hand-eye poses: x, y, z [m], extrinsic xyz Euler angles [rad]."""
    refine_scan: Literal["auto", "always", "never"] = "auto"
    """Whether poses of a scan are refined by its images; "auto" when its views disagree."""
    scan_scale: Literal["poses", "depth"] = "poses"
    """Where a refined scan takes its scale from: "poses" (robot, or a board before) or "depth"."""
    keep_bad: Annotated[bool, COMMON] = False
    """Whether episodes none of whose cameras is usable pass on, too."""
    max_scan_views: Annotated[int, Range(2), Unit("views")] = 40
    """At most this many views of a scan are refined, evenly spread; the others follow the nearest."""
    jobs: Jobs = ALL_CORES
    """Episodes at a time, each in a process; -1 is one a core."""

    def __post_init__(self) -> None:
        super().__post_init__()
        board_of(self).check()


def run(inputs: Inputs, config: CalibrateConfig, out: Output) -> Summary:
    """Write the recording set again, cameras verified or corrected, and calibration.json."""
    recordings = RecordingSet.load(inputs["recordings"].path)
    solved = _solve(inputs, recordings, config)
    done = out.map(recordings.names, partial(_one, recordings, solved, config), jobs=config.jobs, keep_going=True)
    rows = done.values
    bad = {name: error.first_cause().one_line() for name, error in done.errors.items()}
    skipped = recordings.skipped | bad
    if not rows:
        with remembering(solved.warnings):
            raise PlopError(
                "No episode could be calibrated.",
                where=recordings.folder,
                expected="at least one episode",
                found=next(iter(skipped.values()), "the set is empty"),
            )
    facts = {"episodes": rows, "cameras": _worst(rows), "skipped": skipped, **solved.facts()}
    write_json(Recordings(out.path).verdicts, facts)
    replace(
        recordings,
        folder=out.path,
        train=[n for n in recordings.train if n in rows],
        test=[n for n in recordings.test if n in rows],
        skipped=skipped,
    ).save()
    return _summary(facts, list(bad), solved.warnings)


def _solve(inputs: Inputs, recordings: RecordingSet, config: CalibrateConfig) -> Solved:
    boards, poses = (inputs[key].path if key in inputs else None for key in ("board_images", "handeye"))
    if boards is None and poses is None:
        return Solved()
    if not recordings.names:
        raise PlopError("The set of recordings is empty.", where=recordings.folder, expected="at least one episode")
    with recordings.open(recordings.names[0]) as recording:
        return solve(boards, poses, recording, config)


def _one(recordings: RecordingSet, solved: Solved, config: CalibrateConfig, name: str, out: Output) -> dict:
    source, target = recordings.path(name), Recordings(out.path).episode(name)
    first, plain = (target.with_name(f"{target.name}.{end}") for end in ("first", "plain"))
    first.unlink(missing_ok=True)  # of a killed run
    try:
        with recordings.open(name) as recording:
            given = edits_for(recording, solved, config)
        stay = _place(source, plain, first, given, solved, config) if given else {}
        with Recording(first) if first.exists() else recordings.open(name) as recording:
            trusted = frozenset(
                n for n, each in solved.handeye.items() if n not in stay and each.trusted(config.max_disagreement_mm)
            )
            result = calibrate_episode(recording, config, solved.reprojection_px, trusted)
            if not config.keep_bad:
                check_usable(result.cameras, recordings.path(name))
            pass_on(recording.path, target, result.edits)
    finally:
        first.unlink(missing_ok=True)
        plain.unlink(missing_ok=True)
    return {
        "cameras": [_with_handeye(asdict(verdict), solved, stay) for verdict in result.cameras],
        "scan": [asdict(verdict) for verdict in result.scans],
    }


def _place(
    source: Path, plain: Path, first: Path, given: Edits, solved: Solved, config: CalibrateConfig
) -> dict[str, str]:
    """Write the recording with what the user gave; keep recorded poses that the hand-eye ones only make worse."""
    pass_on(source, first, given)
    names = [name for name in solved.handeye if f"cameras/{name}" in given.poses]
    if not names:
        return {}
    pass_on(source, plain, replace(given, poses={}))
    with Recording(plain) as recorded, Recording(first) as replaced:
        stay = contradicted(recorded, replaced, names, config)
    if stay:
        kept = {key: poses for key, poses in given.poses.items() if key.partition("/")[2] not in stay}
        pass_on(source, first, replace(given, poses=kept))
    return stay


def _with_handeye(entry: dict, solved: Solved, stay: dict[str, str]) -> dict:
    """Add a camera's hand-eye columns, and why its hand-eye pose was not used."""
    found = solved.handeye.get(entry["camera"])
    if found is None:
        return {**entry, **NO_COLUMNS}
    why = found.why_not or stay.get(entry["camera"], "")
    said = f"its hand-eye pose was not used, the recorded one stays: {why}" if why else ""
    return {**entry, **found.columns(), "fix": "; ".join(part for part in (said, entry["fix"]) if part)}


def _worst(rows: dict[str, dict]) -> dict[str, dict]:
    """Pick, per camera, the verdict of its worst episode."""
    worst: dict[str, dict] = {}
    for name, row in rows.items():
        for verdict in row["cameras"]:
            entry = {**verdict, "episode": name}
            known = worst.get(verdict["camera"])
            if known is None or _badness(entry) > _badness(known):
                worst[verdict["camera"]] = entry
    return worst


def _badness(entry: dict) -> tuple[int, float]:
    return ORDER.index(entry["verdict"]), entry["disagreement_mm"] or 0.0


def _summary(facts: dict, skipped: list[str], said: list[str]) -> Summary:
    columns = (
        "camera",
        "verdict",
        "reprojection_px",
        "disagreement_mm",
        "edges_px",
        "table_mm",
        "table_deg",
        "tool_share",
        "time_offset_ms",
        "depth_scale",
        "checks",
        *NO_COLUMNS,
        "fix",
    )
    table = [{key: entry[key] for key in columns} for _, entry in sorted(facts["cameras"].items())]
    counts = {kind: sum(entry["verdict"] == kind for entry in facts["cameras"].values()) for kind in ORDER}
    figures = {
        "episodes": len(facts["episodes"]),
        "skipped": len(skipped),
        **{f"cameras_{kind}": count for kind, count in counts.items()},
    }
    known = [e["disagreement_mm"] for e in facts["cameras"].values() if e["disagreement_mm"] is not None]
    if known:
        figures["worst_disagreement_mm"] = max(known)
    warnings = [
        f"camera {name} ({entry['episode']}): {entry['fix']}"
        for name, entry in sorted(facts["cameras"].items())
        if entry["fix"]
    ]
    warnings += [
        f"scan {scan['camera']} ({name}): {scan['fix']}"
        for name, row in facts["episodes"].items()
        for scan in row["scan"]
        if scan["fix"]
    ]
    return Summary(figures, table, said + warnings + [f"{n} was skipped: {facts['skipped'][n]}" for n in skipped])


STAGE = Stage(
    name="calibrate",
    version=6,
    help="Verify the cameras of recordings, correct what can be corrected, give a verdict per camera.",
    config=CalibrateConfig,
    inputs={
        "recordings": InputSpec(("ingest", "simulate"), "recordings to verify"),
        "board_images": InputSpec((), "folder with board images, one sub-folder per camera", optional=True),
        "handeye": InputSpec((), "folder with hand-eye poses, one sub-folder per camera", optional=True),
    },
    run=run,
)
