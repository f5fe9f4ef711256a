"""Checks of views before fusion: height of the table, and alignment of depth and colour."""

from __future__ import annotations

from collections.abc import Sequence

from plop.causes import Cause, Noticed
from plop.errors import PlopError
from plop.geometry.view import View
from plop.recordings.recording import Recording
from plop.sensors.checks.depth_edges import edge_alignment, tolerance_px
from plop.sensors.checks.support_plane import find_support


def check_table(recording: Recording, views: list[View]) -> None:
    """Reject views if none of them sees the table at the height stated in the recording.

    Raises:
        PlopError: Images are rotated, or poses are of another robot; names the heights.
    """
    table = recording.table_z_m
    if table is None:
        return
    planes = {view.camera.name: find_support(view) for view in views}
    known = {name: plane for name, plane in planes.items() if plane is not None and plane.rests}
    if known and all(plane.is_far(table) for plane in known.values()):
        seen = "; ".join(
            f"{name} sees it at z = {plane.height_m:.3f} m, tilted by {plane.tilt_deg:.0f} deg"
            for name, plane in sorted(known.items())
        )
        raise PlopError(
            "The cameras do not see the table at its stated height.",
            where=recording.path,
            expected=f"the plane under the object at table_z = {table:.3f} m",
            found=seen,
            fix="Run `plop calibrate`: it shows whether images are rotated or poses wrong.",
        )


def unaligned(views: Sequence[View]) -> list[str]:
    """Warn of depth that is not aligned to colour in recordings that `calibrate` has not checked."""
    found: list[str] = []
    for view in views:
        edges = edge_alignment([view])
        if edges is not None and edges.moved(tolerance_px(view.camera.width)):
            text = (
                f"camera {view.camera.name}: depth is not aligned to colour, shifted by ({-edges.dx_px:.1f}, "
                f"{-edges.dy_px:.1f}) px, zoom {1 / edges.zoom:.2f}; `plop calibrate` checks it"
            )
            found.append(Noticed(text, Cause.DEPTH, "Run `plop calibrate`, and align depth to colour."))
    return found
