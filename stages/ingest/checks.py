"""Plausibility checks of a simulated episode with intact files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.meshes.tool_checks import check_tool_reach
from plop.geometry.rigid import invert_rigid, transform_points
from plop.lazy_open3d import o3d
from plop.recordings.readers.mesh.sequence import MeshSequence
from stages.ingest.no_contact import no_contact_error
from stages.ingest.resting import check_table
from stages.ingest.sequence_times import check_clock
from stages.ingest.settings import SimulatedConfig

_TOUCH_M = 0.003
_USUAL_M = 0.05
"""Usual smallest size of the larger of object and tool [m]."""
_FLATTEST = 20.0
"""Smallest size of object and tool, as a share of the smallest size of the larger."""
_BLOWN_UP = 4.0
"""Largest extent over time, in units of the largest object: only diverged simulations exceed it."""
_UNITS = {"decimetres": ("dm", 0.1), "centimetres": ("cm", 0.01), "millimetres": ("mm", 1e-3), "inches": ("in", 0.0254)}


def check_plausible(sequence: MeshSequence, path: Path, config: SimulatedConfig) -> list[str]:
    """Reject an episode whose numbers are not metres and seconds, or whose parts are inconsistent.

    Args:
        sequence: The episode.
        path: File with its arrays, for the messages; its JSON is beside it.
        config: Gives workspace_m, largest_m and smallest_m.

    Returns:
        Notes on unusual but accepted values.

    Raises:
        PlopError: Size, position, clock, table or tool are implausible; names file and key.
    """
    side = path.with_suffix(".json")
    check_scale(sequence, path, largest_m=config.largest_m, smallest_m=config.smallest_m)
    check_place(sequence, workspace_m=config.workspace_m)
    points = sequence.vertices.reshape(-1, 3)
    check_tool_reach(sequence.tool_vertices, sequence.world_from_tool, points, f"{path}: world_from_tool")
    return check_clock(sequence, path) + check_table(sequence, side)


def check_scale(sequence: MeshSequence, path: Path, *, largest_m: float, smallest_m: float) -> None:
    """Reject an object or a tool without a plausible size in metres.

    Objects that a robot cuts or presses are 1 to 50 cm long, and so are its tools; the larger of both is between 5 and
    30 cm nearly always. A range of 2 to 50 cm for the larger detects a factor of ten in either direction.

    Args:
        sequence: The episode.
        path: File with its arrays.
        largest_m: Longest edge that object and tool may have [m].
        smallest_m: Longest edge that the larger of both must have [m].

    Raises:
        PlopError: Too large, too small or diverged; names the units that would be right.
    """
    tool = float(np.ptp(sequence.tool_vertices, axis=0).max())
    over_time = np.ptp(sequence.vertices, axis=1).max(1)
    sizes = {
        "object": float(np.ptp(sequence.rest, axis=0).max()),
        "object in the first frame": float(over_time[0]),
        "tool": tool,
    }
    larger = max(sizes.values())
    for what, size in sizes.items():
        if size > largest_m or size < smallest_m / _FLATTEST or larger < smallest_m:
            fits = {name: key for name, (key, scale) in _UNITS.items() if smallest_m <= larger * scale <= largest_m}
            judged = size if larger >= smallest_m else larger  # one of both, or the whole scene
            small = next((factor for factor in (10, 100, 1000) if factor * judged > _USUAL_M), None)
            guess = (
                f": {' or '.join(fits)}?"
                if size > largest_m and fits
                else f": {small} times too small?"
                if size <= largest_m and small
                else ""
            )
            unit = f'"{next(iter(fits.values()))}"' if size > largest_m and len(fits) == 1 else "..."
            key = "tool_vertices" if what == "tool" else "vertices"
            raise PlopError(
                f"The {what} has an implausible size.",
                where=f"{path}: {key}",
                expected=f"{smallest_m:g} to {largest_m:g} m for the larger of object and tool",
                found=f"{size:.4g} m{guess}",
                fix=f"Convert it to metres; where object, tool and poses share the unit, declare it in "
                f'{path.with_suffix(".json").name}: "units": {{"length": {unit}}}. If the size '
                "is right: --largest-m, --smallest-m.",
            )
    if over_time.max() > _BLOWN_UP * largest_m:
        raise PlopError(
            "The object has an implausible size.",
            where=f"{path}: vertices, frame {int(over_time.argmax())}",
            expected=f"at most {_BLOWN_UP * largest_m:g} m at any time",
            found=f"{over_time.max():.4g} m",
            fix="The simulation probably diverged: leave it out.",
        )


def check_place(sequence: MeshSequence, *, workspace_m: float) -> None:
    """Reject an object that starts far from the world's origin.

    Args:
        sequence: The episode.
        workspace_m: Largest initial distance of the object [m].

    Raises:
        PlopError: It is farther away.
    """
    middle = (sequence.vertices[0].min(0) + sequence.vertices[0].max(0)) / 2
    if np.linalg.norm(middle) > workspace_m:
        raise PlopError(
            "The object is outside the workspace.",
            where=sequence.name,
            expected=f"within {workspace_m:g} m of the world's origin",
            found=f"centre at {np.round(middle, 3).tolist()} m",
            fix="Check the frame and the unit, or raise workspace_m.",
        )


def tool_gap_m(sequence: MeshSequence) -> float:
    """Measure how close the tool ever comes to the object's surface [m], to about 2 mm."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(sequence.tool_vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(sequence.tool_faces.astype(np.uint32)),
    )
    best = np.inf
    for vertices, world_from_tool in zip(sequence.vertices, sequence.world_from_tool, strict=True):
        corner = vertices[sequence.faces]
        points = np.concatenate([vertices, corner.mean(1), (corner + np.roll(corner, 1, axis=1)).reshape(-1, 3) / 2])
        local = transform_points(invert_rigid(world_from_tool), points).astype(np.float32)
        best = min(best, float(scene.compute_distance(o3d.core.Tensor.from_numpy(local)).numpy().min()))
    return best


def check_contact(sequence: MeshSequence, path: Path) -> None:
    """Reject an episode in which the tool never touches the object: no model learns contact from it.

    Raises:
        PlopError: There is no contact; names file, key and the smallest distance.
    """
    gap = tool_gap_m(sequence)
    if gap > _TOUCH_M:
        raise no_contact_error(
            f"{path}: world_from_tool",
            _TOUCH_M,
            f"{sequence.name}, {1000 * gap:.1f} mm at its closest",
            "Correct the tool's poses or mesh",
        )
