"""What one camera's pictures say of themselves: depth against colour, against the table, and against the drawn tool.

Cameras that share a fault agree with each other. These checks ask none of the others. A fault that is named here is one
that no pose and no depth scale mends, unless it says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from plop.geometry.view import View
from plop.recordings.recording import Recording
from plop.sensors.checks.depth_edges import EdgeAlignment, edge_alignment, tolerance_px
from plop.sensors.checks.support_plane import FAR_OFF_DEG, FAR_OFF_M, Support, find_support
from plop.sensors.checks.tool_fit import THROUGH, ToolFit, ToolLook
from stages.calibrate.orientation import orientation_fault
from stages.calibrate.verify import Change, read_views

if TYPE_CHECKING:
    from stages.calibrate.stage import CalibrateConfig

SAME_M = 0.004
"""Heights of the table that differ by less are the same [m]."""
BELOW_SHARE = 10.0
"""So many percent of the object must lie below the table before it is said to [%]."""


class Fault(Enum):
    """What an independent check found wrong."""

    TURNED = "turned"
    DISTANCE = "distance"
    UNALIGNED = "unaligned"
    CURVED = "curved"
    TABLE = "table"
    TOOL = "tool"

    @property
    def mendable(self) -> bool:
        """Whether a pose or a depth scale may explain it."""
        return self is Fault.TABLE


@dataclass(frozen=True)
class CameraEvidence:
    """The independent checks of one camera."""

    edges: EdgeAlignment | None = None
    support: Support | None = None
    tool: ToolFit | None = None
    table_mm: float | None = None
    """Height of the support over table_z [mm]; None where either is unknown."""
    faults: Mapping[Fault, str] = field(default_factory=dict)
    """What is wrong, in words with the fix; the first is the first cause."""
    agreed: tuple[str, ...] = ()
    """Checks that were made and agreed: "edges", "table", "flat", "tool"."""

    @property
    def remark(self) -> str:
        """What is odd without being a fault."""
        if self.faults or self.tool is None or self.tool.through is None or self.tool.through <= THROUGH:
            return ""
        return (
            f"depth looks through {100 * self.tool.through:.0f} % of the drawn tool: a blade that depth does not "
            "see (glossy, transparent), or a wrong mesh, mount or clock"
        )

    @property
    def broken(self) -> bool:
        """Whether something is wrong that no pose or depth scale mends."""
        return any(not fault.mendable for fault in self.faults)

    @property
    def placed(self) -> bool:
        """Whether something says that depth is where it should be; flatness alone would not show another lens."""
        return bool({"edges", "table", "tool"} & set(self.agreed))

    @property
    def table_right(self) -> bool:
        """Whether the table is where it should be."""
        return "table" in self.agreed


def gather(
    recording: Recording, frames: Sequence[int], config: CalibrateConfig, *, change: Change | None = None
) -> dict[str, CameraEvidence]:
    """Make all independent checks of all cameras.

    Args:
        recording: Open recording.
        frames: Frames to look at.
        config: Limits.
        change: Trial correction per camera.
    """
    shots = [read_views(recording, frame, change) for frame in frames]
    tool_poses = list(recording.world_from_tool[list(frames)])
    look = ToolLook(recording.tool_mesh, recording.table_z_m)
    table = recording.table_z_m
    found = {}
    for number, name in enumerate(recording.camera_names):
        views = [shot[number] for shot in shots]
        found[name] = _one_camera(views, tool_poses, look, table, config)
    found = _with_shared_table(found)
    said = _tool_fault(shots, tool_poses, look, found)
    return {name: _with_tool(each, said) for name, each in found.items()}


def _one_camera(
    views: list[View], tool_poses: Sequence[np.ndarray], look: ToolLook, table: float | None, config: CalibrateConfig
) -> CameraEvidence:
    support = find_support(views[0])
    tool, edges = look.fit(views, tool_poses), edge_alignment(views)
    faults: dict[Fault, str] = {}
    agreed = []
    table_mm = None if support is None or table is None else 1e3 * (support.height_m - table)
    near_px = tolerance_px(views[0].camera.width)
    unaligned = edges is not None and edges.moved(near_px)
    if (
        support is not None
        and not unaligned
        and (said := orientation_fault(views, tool_poses, look, support, table_mm, tool, config))
    ):
        faults[Fault.TURNED] = said
    if support is not None and not faults:
        if said := _read_as_distance(views[0], support, table, config):
            faults[Fault.DISTANCE] = said
        elif support.bend.curved:
            faults[Fault.CURVED] = _curved(support)
        elif support.bend.tells:
            agreed.append("flat")
    if edges is not None and unaligned:
        faults.setdefault(Fault.UNALIGNED, _unaligned(edges))
    elif edges is not None and edges.agrees(near_px):
        agreed.append("edges")
    if support is not None and table_mm is not None and _is_table(support, table_mm):
        if abs(table_mm) <= config.max_table_mm and support.tilt_deg <= config.max_table_deg:
            agreed.append("table")
        else:
            faults.setdefault(Fault.TABLE, _table_off(table_mm, support))
    elif support is None and table is not None and (deep := _below_table_mm(views[0], table)) > config.max_table_mm:
        faults[Fault.TABLE] = (
            f"part of the object lies {deep:.0f} mm below table_z: its depth, its pose or table_z is wrong"
        )
    if tool.through is not None and tool.through < THROUGH / 2:
        agreed.append("tool")
    return CameraEvidence(edges, support, tool, table_mm, faults, tuple(agreed))


def _is_table(support: Support, table_mm: float) -> bool:
    """Whether a plane is the table: the object rests on it, or it is about where the table is said to be."""
    return support.rests or (abs(table_mm) < 1e3 * FAR_OFF_M and support.tilt_deg < FAR_OFF_DEG)


def _read_as_distance(view: View, support: Support, table: float | None, config: CalibrateConfig) -> str:
    """Say so when depth is distance along the ray: by the bend of the table, or by its place."""
    bend = support.bend
    fix = (
        "its depth is the distance along the ray, not along the optical axis: divide it by the length of the ray "
        "(x/f, y/f, 1) before ingest"
    )
    if bend.distance:
        return f"{fix} (the table is bent by {bend.p * bend.by_mm:.0f} mm in just this way)"
    if table is None or bend.p < 0.5 or bend.p < 2.5 * bend.error:
        return ""
    other = find_support(view, as_distance=True)
    if other is None:
        return ""
    off_mm = [1e3 * abs(each.height_m - table) for each in (support, other)]
    if off_mm[0] > config.max_table_mm / 2 and off_mm[1] < 0.25 * off_mm[0] and other.tilt_deg < config.max_table_deg:
        return f"{fix} (so read the table comes from {off_mm[0]:.0f} mm off to {off_mm[1]:.0f} mm)"
    return ""


def _curved(support: Support) -> str:
    bend = support.bend
    why = (
        "a lens that was not undistorted"
        if bend.lens_fits < 0.7
        else "depth divided by the ray's length"
        if (abs(bend.p + 1) < 0.3)
        else "a depth that is warped"
    )
    return f"the table is seen bent by {abs(bend.p * bend.by_mm):.0f} mm: {why}; undistort depth before ingest"


def _unaligned(edges: EdgeAlignment) -> str:
    return (
        f"depth is not aligned to the colour picture: shifted by ({-edges.dx_px:.1f}, {-edges.dy_px:.1f}) px, "
        f"zoom {1 / edges.zoom:.2f}; align depth to colour before ingest (its own lens has other intrinsics)"
    )


def _table_off(table_mm: float, support: Support) -> str:
    return (
        f"it sees the table {table_mm:+.1f} mm from table_z, tilted by {support.tilt_deg:.1f} deg: its depth "
        "(scale, or not aligned to colour), its pose or table_z is wrong"
    )


def _below_table_mm(view: View, table: float) -> float:
    points = view.camera.back_project(view.depth_m, view.object_mask)
    return 1e3 * (table - float(np.percentile(points[:, 2], BELOW_SHARE))) if len(points) > 20 else 0.0


def _with_shared_table(found: dict[str, CameraEvidence]) -> dict[str, CameraEvidence]:
    """Blame table_z, or what all cameras share, when all see the table at one other height."""
    seen = {name: each for name, each in found.items() if each.table_mm is not None and each.support is not None}
    off = [each for each in seen.values() if list(each.faults) == [Fault.TABLE]]
    if len(off) < 2 or len(off) < len(seen):
        return found
    heights = [each.table_mm for each in off if each.table_mm is not None]
    if np.ptp(heights) > 1e3 * SAME_M:
        return found
    z = np.mean([each.support.height_m for each in off if each.support is not None])
    said = (
        f"all cameras see the table {np.mean(heights):+.1f} mm from table_z, at z = {z:.4f} m: correct table_z, or "
        "what all cameras share (the unit or scale of depth, the robot's base)"
    )
    return {name: replace(each, faults={Fault.TABLE: said}) if each in off else each for name, each in found.items()}


def _tool_fault(
    shots: list[list[View]], tool_poses: Sequence[np.ndarray], look: ToolLook, found: Mapping[str, CameraEvidence]
) -> str:
    """Say how the tool's mesh would fit what was measured, "" where it does or nothing is clearly better.

    Looked at on the frame where the tool is highest, in the cameras without another fault that see most of it.
    """
    order = list(found)
    names = [name for name in order if not found[name].faults and found[name].tool is not None]
    frame = int(np.argmax([pose[2, 3] for pose in tool_poses]))
    best = sorted(names, key=lambda name: -(found[name].tool or ToolFit(0, 0)).judged_px)[:3]
    seen = [([shots[frame][order.index(name)]], [tool_poses[frame]]) for name in best]
    axes = look.better_axes(seen)
    if axes is not None:
        return (
            f"the tool's mesh has other axes than its pose: {axes.name} about its frame's origin it fits what the "
            "cameras measured; export the mesh so, or correct flange_from_tool"
        )
    through = [fit.through for name in best if (fit := found[name].tool) is not None and fit.through is not None]
    if not through or np.median(through) <= THROUGH:
        return ""
    shift = look.better_place(seen)
    if shift is None:
        return ""
    x, y, z = 1e3 * shift
    return (
        f"the tool is not where its pose says: moved by ({x:+.0f}, {y:+.0f}, {z:+.0f}) mm in its frame it fits "
        "what the cameras measured; correct flange_from_tool or the mesh"
    )


def _with_tool(evidence: CameraEvidence, said: str) -> CameraEvidence:
    """Add what is wrong with the tool; another fault of the camera explains a tool that is not there."""
    if evidence.faults or not said:
        return evidence
    agreed = tuple(each for each in evidence.agreed if each != "tool")
    return replace(evidence, faults={Fault.TOOL: said}, agreed=agreed)
