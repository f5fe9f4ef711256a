"""Which views may be fused: not those that see the table elsewhere than it is."""

from __future__ import annotations

from plop.errors import PlopError
from plop.geometry.view import View
from plop.recordings.recording import Recording
from plop.sensors.checks.support_plane import find_support


def check_table(recording: Recording, views: list[View]) -> None:
    """Refuse views none of which sees the object on a table where the recording says that it is.

    Raises:
        PlopError: Pictures are turned, or poses are another robot's; names the heights.
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
            "The cameras see the table elsewhere than it is.",
            where=recording.path,
            expected=f"the plane under the object at table_z = {table:.3f} m",
            found=seen,
            fix="Run `plop calibrate`: it says whether pictures are turned or poses wrong.",
        )
