"""Episodes from recordings: the filter's Gaussians on the surface are the tracked points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from plop.dynamics.initial_surface import LEAST_POINTS, ON_SURFACE_M, FirstFrame
from plop.errors import PlopError
from plop.gaussians.splat_ply import read_splat
from plop.gaussians.state import Gaussians
from plop.gaussians.trajectory import Trajectory
from plop.physics.engine.tool_motion import ToolMotion
from plop.recordings.recording import Recording
from plop.tracking.episode import POINTS, Episode, patches_of
from plop.tracking.hidden_points import seen_points


def episode_from_track(
    recording_path: Path, splat_path: Path, track_path: Path, *, points: int = POINTS, seed: int = 0
) -> Episode:
    """Read one episode from its recording and the filter's states.

    Args:
        recording_path: The recording.
        splat_path: Gaussians at the first frame, `<episode>/object.ply` of `plop fit-init`.
        track_path: `<episode>.h5` of `plop filter`.
        points: Number of tracked points.
        seed: Seed of the choice among the Gaussians.

    Raises:
        PlopError: The track is of another recording or another fit, or too few Gaussians lie on the measured surface.
    """
    with Recording.open(recording_path) as recording:
        start = FirstFrame.of(recording)
        times, poses, mesh = recording.time_s.astype(float), recording.world_from_tool, recording.tool_mesh
        table = recording.table_z_m
    first = read_splat(splat_path)
    paths, sides = _paths(first, track_path, len(times))
    usable = np.flatnonzero(start.shown(first) & np.isfinite(paths).all((0, 2)))
    if len(usable) < LEAST_POINTS:
        raise PlopError(
            "Too few Gaussians lie on the measured surface.",
            where=track_path,
            expected=f"at least {LEAST_POINTS} within {1000 * ON_SURFACE_M:g} mm",
            found=str(len(usable)),
            fix="Check the fit with `plop export --kind splats`; fit again with more steps.",
        )
    generator = np.random.default_rng([seed, 73])
    chosen = np.sort(generator.choice(usable, min(points, len(usable)), replace=False))
    chosen = chosen[_settled_side(paths[:, chosen], sides[chosen])]
    vertices, faces = start.surface(paths[0, usable])
    track = paths[:, chosen]
    tool = ToolMotion(mesh.vertices, mesh.faces, times, poses.astype(float))
    return Episode(
        recording_path.stem,
        times,
        track,
        track_noise_m(track),
        patches_of(track[0], track[-1]),
        tool,
        table,
        vertices,
        faces,
        seen_points(tool, track),
    )


def _paths(first: Gaussians, path: Path, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Track the Gaussians of the first frame: positions [T, N, 3] [m] and sides at the end [N].

    The filter may split and merge; the position of a Gaussian is the mean of its descendants, NaN when it has none.
    """
    count = len(first)
    paths = np.full((frames, count, 3), np.nan)
    paths[0] = first.means.numpy()  # of a track that starts at frame 1
    sides = np.zeros(count)
    with Trajectory(path) as track:
        known = track.frames("updated")
        if not known or known[-1] != frames - 1:
            raise PlopError(
                "The track is of another recording.",
                where=path,
                expected=f"frames up to {frames - 1}",
                found=f"frames up to {known[-1] if known else 'none'}",
                fix="Run `plop filter` on these recordings.",
            )
        for frame in known:
            state = track.read("updated", frame)
            ids = state.ids.numpy()
            if len(ids) and ids.max() >= count:
                raise PlopError(
                    "The Gaussians of the track are not those of the fit.",
                    where=path,
                    expected=f"{count} Gaussians of the first frame",
                    found=f"number {ids.max()}",
                    fix="Run `plop filter` with the same --init.",
                )
            number = np.bincount(ids, minlength=count)[:, None]
            sums = np.stack([np.bincount(ids, state.means[:, c].numpy(), count) for c in range(3)], 1)
            paths[frame] = np.where(number > 0, sums / np.maximum(number, 1), np.nan)
            sides[ids] = track.extra("updated", frame, "side").numpy()
    return paths, sides


def _settled_side(paths: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Discard points that end far from their neighbours of the same side: outliers torn off at the cut."""
    drift = paths[-1] - paths[0]
    keep = np.ones(len(sides), bool)
    for side in np.unique(sides):
        own = np.flatnonzero(sides == side)
        if len(own) < 8:
            keep[own] = side == 0
            continue
        _, neighbours = cKDTree(paths[0, own]).query(paths[0, own], k=8)
        stray = np.linalg.norm(drift[own] - np.median(drift[own][neighbours], 1), axis=1)
        keep[own] = stray < max(0.003, 4 * float(np.median(stray)))
    return keep


def track_noise_m(paths: np.ndarray) -> float:
    """Estimate the noise of one coordinate from the roughness of the paths in time [m].

    The second difference of white noise has six times its variance; motion is smooth at that scale. Errors
    common to neighbouring frames (a filter's lag) are not included: they are part of the base's misfit.
    """
    rough = paths[2:] - 2 * paths[1:-1] + paths[:-2]
    return float(max(float(np.median(np.abs(rough))) * 1.4826 / np.sqrt(6), 2e-5))
