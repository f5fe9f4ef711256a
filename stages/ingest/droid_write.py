"""Write one opened DROID episode as a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh

from plop.causes import Cause
from plop.errors import PlopError, remembering
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel
from plop.recordings.readers.droid.camera import DroidCamera
from plop.recordings.readers.droid.depth import ExportedDepth
from plop.recordings.readers.droid.episode import DroidEpisode
from plop.recordings.recording import Mesh
from plop.recordings.writer import RecordingWriter
from stages.ingest.camera_conventions import check_conventions
from stages.ingest.depth_points import estimate_table_z, world_points
from stages.ingest.droid_checks import check_object, check_views, closest_touch_m, object_cloud, sees_nothing
from stages.ingest.folder_masks import FolderMasker
from stages.ingest.masks import GeometricMasker, Masker, MaskRules, Picture
from stages.ingest.no_contact import no_contact_error


@dataclass(frozen=True)
class WriteOptions:
    """Options of writing an episode."""

    environment: str
    size: int
    workspace: np.ndarray
    """Default where plop_episode.json has none, shape [2, 3] [m]."""
    rules: MaskRules
    masks: Path | None
    binary_masks: bool
    touch_m: float
    """Largest distance of tool and object that counts as contact [m]."""
    keep_untouched: bool
    """Also write episodes without contact."""


@dataclass
class Written:
    """Facts of a written recording."""

    frames: int
    cameras: list[str]
    scan_frames: int
    depth: str
    object_px: float
    """Mean area of the object's mask over cameras and frames [px]."""
    table_z_m: float
    closest_touch_mm: float
    poses: dict[str, list[list[float]]]
    warnings: list[str] = field(default_factory=list)


def write_episode(
    episode: DroidEpisode, path: Path, options: WriteOptions, progress: Callable[[int, int], None]
) -> Written:
    """Check the first frame, then write every frame of every camera.

    Args:
        episode: The episode.
        path: Path of the recording.
        options: Sizes and rules.
        progress: Called with the number of finished frames and of all frames.

    Raises:
        PlopError: No camera sees the object, the tool never touches it, or a file of the episode cannot be read. It
            has the warnings collected before, including those of the episode.
    """
    warnings: list[str] = []
    with remembering(episode.warnings), remembering(warnings):
        return _written(episode, path, options, progress, warnings)


def _written(
    episode: DroidEpisode, path: Path, options: WriteOptions, progress: Callable[[int, int], None], warnings: list[str]
) -> Written:
    name = episode.folder.name
    workspace = options.workspace if episode.notes.workspace is None else episode.notes.workspace
    first = _first_pictures(episode, options, warnings)
    stored = {camera.serial: camera.stored_pose6 for camera in episode.cameras if camera.stored_pose6 is not None}
    check_conventions(first, stored, workspace, episode.notes.table_z_m, name)
    table_z = _table_height(episode, first, workspace, warnings)
    geometric = GeometricMasker(workspace, table_z, episode.tool, options.rules)
    masker: Masker = geometric
    if options.masks is not None:
        frames = {(name, camera.serial): camera.video.frames for camera in episode.cameras}
        if episode.scan is not None:
            frames[episode.scan.episode, episode.scan.camera.serial] = episode.scan.camera.video.frames
        masker = FolderMasker(options.masks, frames, binary=options.binary_masks, geometric=geometric)
        warnings += masker.warnings()
    clouds = object_cloud(first, {serial: masker.mask(picture) for serial, picture in first.items()})
    warnings += check_views(first, clouds, workspace, table_z, name)  # before the consequences of wrong extrinsics
    warnings += check_object(first, clouds, workspace, name)
    gap = _closest_touch(episode, np.concatenate(list(clouds.values())), options)
    cameras = [camera for camera in episode.cameras if camera.serial in first]
    writer = RecordingWriter(
        path,
        name=name,
        source="droid",
        environment=options.environment,
        table_z_m=table_z,
        time_s=episode.time_s,
        tool_mesh=episode.tool,
        world_from_tool=episode.world_from_tool,
    )
    with writer:
        area = _write_pictures(writer, episode, cameras, masker, options, progress, warnings)
        if episode.scan is not None:
            _write_scan(writer, episode, masker, options, warnings)
    for camera in [*cameras, *([episode.scan.camera] if episode.scan else [])]:
        if isinstance(camera.depth, ExportedDepth):
            warnings += camera.depth.warnings()
    return Written(
        frames=len(episode.rows),
        cameras=[camera.serial for camera in cameras],
        scan_frames=len(episode.scan.rows) if episode.scan else 0,
        depth=", ".join(sorted({camera.depth.name for camera in cameras})),
        object_px=round(area, 1),
        table_z_m=round(table_z, 4),
        closest_touch_mm=round(1000 * gap, 1),
        poses={camera.serial: camera.world_from_cam[episode.rows[0]].round(6).tolist() for camera in cameras},
        warnings=warnings,
    )


def _first_pictures(episode: DroidEpisode, options: WriteOptions, warnings: list[str]) -> dict[str, Picture]:
    """Read the first frame of every camera and leave out cameras without usable images."""
    pictures, reasons = {}, []
    for camera in episode.cameras:
        rgb, depth = next(camera.images(episode.rows[:1], *camera.size(options.size)))
        picture = _picture(episode, camera, options.size, 0, rgb, depth)
        reason = sees_nothing(picture)
        if reason:
            reasons.append(f"camera {camera.serial}, {camera.video.path.name} frame {picture.frame}: {reason}")
            warnings.append(f"{episode.folder.name}: {reasons[-1]}; it is left out")
        else:
            pictures[camera.serial] = picture
    if not pictures:
        raise PlopError(
            "No camera has a usable image.",
            where=episode.folder.folder,
            expected="an image with depth",
            found="; ".join(reasons),
            fix="Check the videos and depth of this episode.",
            cause=Cause.DEPTH,
        )
    return pictures


def _picture(
    episode: DroidEpisode, camera: DroidCamera, size: int, index: int, rgb: np.ndarray, depth: np.ndarray
) -> Picture:
    width, height = camera.size(size)
    row = episode.rows[index]
    pinhole = Camera(camera.serial, width, height, camera.intrinsics_at(width, height), camera.world_from_cam[row])
    return Picture(
        pinhole,
        rgb,
        depth,
        episode.world_from_tool[index],
        episode.world_from_flange[index],
        episode.folder.name,
        int(camera.frame_of_row[row]),
    )


def _table_height(
    episode: DroidEpisode, pictures: dict[str, Picture], workspace: np.ndarray, warnings: list[str]
) -> float:
    if episode.notes.table_z_m is not None:
        return episode.notes.table_z_m
    points = np.concatenate([world_points(p.camera, p.depth_m)[p.depth_m > 0] for p in pictures.values()])
    height = estimate_table_z(points, workspace)
    if height is None:
        warnings.append(f"{episode.folder.name}: no table found; its height is assumed to be the workspace's floor")
        return float(workspace[0, 2])
    warnings.append(f"{episode.folder.name}: plop_episode.json gives no table_z; the depth shows {height:.3f} m")
    return height


def _closest_touch(episode: DroidEpisode, cloud: np.ndarray, options: WriteOptions) -> float:
    gap, frame = closest_touch_m(_surface_points(episode.tool), episode.world_from_tool, cloud)
    if gap > options.touch_m and not options.keep_untouched:
        raise no_contact_error(
            episode.folder.folder,
            options.touch_m,
            f"{1000 * gap:.0f} mm at its closest, in frame {frame}, row {episode.rows[frame]}",
            "Check flange_from_tool, the units of the tool's mesh, and interaction",
        )
    return gap


def _surface_points(mesh: Mesh, count: int = 2000) -> np.ndarray:
    """Spread points over a mesh, deterministically, shape [N, 3]."""
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, _ = trimesh.sample.sample_surface(body, count, seed=0)
    return np.concatenate([mesh.vertices, np.asarray(points)])


def _write_pictures(
    writer: RecordingWriter,
    episode: DroidEpisode,
    cameras: list[DroidCamera],
    masker: Masker,
    options: WriteOptions,
    progress: Callable[[int, int], None],
    warnings: list[str],
) -> float:
    """Write all cameras; return the mean area of the object's mask [px]."""
    areas: list[int] = []
    for number, camera in enumerate(cameras):
        width, height = camera.size(options.size)
        writer.add_camera(
            camera.serial, camera.intrinsics_at(width, height), camera.world_from_cam[episode.rows], height, width
        )
        empty = []
        for index, (rgb, depth) in enumerate(camera.images(episode.rows, width, height)):
            mask = masker.mask(_picture(episode, camera, options.size, index, rgb, depth))
            writer.write_frame(camera.serial, index, rgb, depth, mask)
            areas.append(int((mask == MaskLabel.OBJECT).sum()))
            if not areas[-1]:
                empty.append(index)
            progress(number * len(episode.rows) + index + 1, len(cameras) * len(episode.rows))
        if empty:
            warnings.append(
                f"{episode.folder.name}: camera {camera.serial}: the object's mask is empty in "
                f"{len(empty)} of {len(episode.rows)} frames, the first is frame {empty[0]}"
            )
    return float(np.mean(areas))


def _write_scan(
    writer: RecordingWriter, episode: DroidEpisode, masker: Masker, options: WriteOptions, warnings: list[str]
) -> None:
    scan = episode.scan
    assert scan is not None
    camera, (width, height) = scan.camera, scan.camera.size(options.size)
    writer.add_camera(
        camera.serial,
        camera.intrinsics_at(width, height),
        camera.world_from_cam[scan.rows],
        height,
        width,
        group="scan",
    )
    seen = 0
    for index, (rgb, depth) in enumerate(camera.images(scan.rows, width, height)):
        row = scan.rows[index]
        pinhole = Camera(camera.serial, width, height, camera.intrinsics_at(width, height), camera.world_from_cam[row])
        frame = int(camera.frame_of_row[row])
        mask = masker.mask(Picture(pinhole, rgb, depth, scan.world_from_tool[index], None, scan.episode, frame))
        seen += bool((mask == MaskLabel.OBJECT).any())
        writer.write_frame(camera.serial, index, rgb, depth, mask, group="scan")
    if seen < len(scan.rows) / 2:
        warnings.append(f"{episode.folder.name}: the scan shows the object in only {seen} of {len(scan.rows)} frames")
