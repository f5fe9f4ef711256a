"""Record a simulated episode with virtual RGB-D cameras, including their faults."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.recordings.readers.mesh.resample import resampled
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.recordings.recording import Mesh
from plop.recordings.writer import RecordingWriter
from plop.render.virtual_cameras.arm import hide_behind_arm
from plop.render.virtual_cameras.blender import BlenderRenderer
from plop.render.virtual_cameras.mesh_raycast import Light, Look, MeshRenderer
from plop.render.virtual_cameras.noise import add_colour_noise, add_depth_noise
from plop.render.virtual_cameras.rig import ring_cameras
from plop.render.virtual_cameras.settings import CameraSettings
from plop.render.virtual_cameras.texture import SolidTexture, seed_from
from plop.sensors.faults.library import Faults, frame_share
from plop.sensors.faults.tool import Tool

Render = Callable[[int, Camera], View]
"""`(frame, camera) -> the recorded view`."""


@dataclass(frozen=True)
class Disturbances:
    """Faults of cameras and tool, besides noise of depth; none by default."""

    faults: Faults = field(default_factory=lambda: Faults({}))
    """Wrong clocks, poses and depths, by camera; a wrong tool."""
    colour_noise: float = 0.0
    """Standard deviation of noise added to each channel, of 255 [-]."""
    arm_m: float = 0.0
    """Width of an arm that holds the tool and occludes the view [m]; 0: no arm."""


NOTHING = Disturbances()


def record(
    path: Path, sequence: MeshSequence, settings: CameraSettings, disturbances: Disturbances = NOTHING, *, seed: int = 0
) -> Iterator[float]:
    """Write one recording; yield the finished share, 0..1.

    Args:
        path: Path of the recording.
        sequence: The episode.
        settings: Cameras, light, noise of depth.
        disturbances: Further faults.
        seed: Seed of texture and noise; the texture depends on it and on the environment's name only.

    Raises:
        PlopError: A camera does not see the object at the start, or Blender is missing or used with faults.
    """
    cameras = cameras_of(sequence, settings)
    images = len(sequence) * len(cameras)
    with ExitStack() as stack:
        render = disturbed_render(sequence, cameras, settings, disturbances, stack, seed=seed)
        for done in write_episode(path, as_recorded(sequence, disturbances.faults), cameras, render):
            yield done / images


def as_recorded(sequence: MeshSequence, faults: Faults) -> MeshSequence:
    """Give an episode with the tool as the robot says it is."""
    true = Tool(sequence.times, sequence.world_from_tool, sequence.tool_vertices, sequence.tool_faces)
    said = faults.recorded_tool(true)
    return replace(sequence, world_from_tool=said.world_from_tool, tool_vertices=said.vertices)


def cameras_of(sequence: MeshSequence, settings: CameraSettings) -> list[Camera]:
    """Place the cameras around the object at rest."""
    return ring_cameras(
        sequence.rest,
        count=settings.count,
        size_px=settings.size,
        fov_deg=settings.fov_deg,
        low_deg=settings.low_deg,
        high_deg=settings.high_deg,
        azimuth_deg=settings.azimuth_deg,
        room_m=settings.room_m,
        distance_m=settings.distance_m,
    )


def disturbed_render(
    sequence: MeshSequence,
    cameras: list[Camera],
    settings: CameraSettings,
    disturbances: Disturbances,
    stack: ExitStack,
    *,
    seed: int = 0,
) -> Render:
    """Return the function that renders the recorded view of a camera at a frame, including faults and noise.

    Args:
        sequence: The episode.
        cameras: Cameras with their stated poses.
        settings: Light, texture and noise.
        disturbances: Faults of the cameras.
        stack: Closes the renderer.
        seed: Seed of texture and noise.
    """
    faults = disturbances.faults
    if faults and settings.renderer == "blender":
        raise PlopError(
            "Blender cannot render cameras with faults.",
            where="renderer",
            found="blender",
            fix="Use the renderer raycast, or remove the faults.",
        )
    shared = _renderer(sequence, cameras, settings, stack, seed)
    shown = {
        camera.name: np.array([faults.true_time(camera.name, float(t)) for t in sequence.times]) for camera in cameras
    }
    late = {
        name: _renderer(resampled(sequence, times), cameras, settings, stack, seed)
        for name, times in shown.items()
        if (times != sequence.times).any()
    }

    def render(frame: int, camera: Camera) -> View:
        pose = faults.true_pose(camera.name, frame_share(frame, len(sequence)), camera.world_from_cam)
        true = replace(camera, world_from_cam=pose)
        view = late.get(camera.name, shared)(frame, true)
        if disturbances.arm_m:
            view = hide_behind_arm(view, sequence.world_from_tool[frame], sequence.tool_vertices, disturbances.arm_m)
        own = (seed, sequence.name, camera.name, frame)
        depth = add_depth_noise(
            faults.depth(camera.name, view.depth_m),
            noise_m=settings.depth_noise_m,
            quantization_m=settings.depth_quantization_m,
            dropout=settings.depth_dropout,
            seed=own,
        )
        rgb = add_colour_noise(view.rgb, noise=disturbances.colour_noise, seed=own)
        return View(camera, rgb, depth, view.mask)

    return render


def _renderer(
    sequence: MeshSequence, cameras: list[Camera], settings: CameraSettings, stack: ExitStack, seed: int
) -> Render:
    drawn = seed_from(sequence.environment, seed)
    texture = SolidTexture.dough(drawn) if settings.texture == "dough" else SolidTexture.from_seed(drawn)
    look = Look(texture, Light(settings.ambient, settings.directional))
    if settings.renderer == "raycast":
        return MeshRenderer(sequence, look, supersample=settings.supersample).render
    exact = MeshRenderer(sequence, look, supersample=1)
    blender = stack.enter_context(
        BlenderRenderer(sequence, look, cameras, executable=settings.blender, samples=settings.blender_samples)
    )
    return lambda frame, camera: blender.recolour(exact.render(frame, camera), frame)


def write_episode(path: Path, sequence: MeshSequence, cameras: Sequence[Camera], render: Render) -> Iterator[int]:
    """Render every frame of every camera into a recording; yield the number of images written so far.

    Args:
        path: Path of the recording.
        sequence: The episode.
        cameras: Fixed cameras.
        render: Returns one image, including noise.

    Raises:
        PlopError: A camera does not see the object at the start, or the disk is full.
    """
    writer = RecordingWriter(
        path,
        name=sequence.name,
        source=sequence.source,
        environment=sequence.environment,
        table_z_m=sequence.table_z_m,
        time_s=sequence.times,
        world_from_tool=sequence.world_from_tool,
        tool_mesh=Mesh(sequence.tool_vertices, sequence.tool_faces),
    )
    with writer:
        for camera in cameras:
            poses = np.tile(camera.world_from_cam, (len(sequence), 1, 1))
            writer.add_camera(camera.name, camera.intrinsics, poses, camera.height, camera.width)
        done = 0
        for frame in range(len(sequence)):
            for camera in cameras:
                view = render(frame, camera)
                if frame == 0 and not (view.mask == MaskLabel.OBJECT).any():
                    raise PlopError(
                        "A camera does not see the object.",
                        where=f"{sequence.name}, {camera.name}",
                        expected="object pixels in the first frame",
                        found="none",
                        fix="Check elevation, distance, field of view and the table.",
                    )
                writer.write_frame(camera.name, frame, view.rgb, view.depth_m, view.mask)
                done += 1
                yield done
        _write_truth(writer, sequence)


def _write_truth(writer: RecordingWriter, sequence: MeshSequence) -> None:
    for key, value in sorted(sequence.truth.items()):
        writer.add_truth(key, value)
    writer.add_truth("surface_vertices_m", sequence.vertices.astype(np.float32))
    writer.add_truth("surface_rest_vertices_m", sequence.rest.astype(np.float32))
    writer.add_truth("surface_faces", sequence.faces)
    writer.add_truth("surface_is_cut", sequence.is_cut_face)
    writer.add_truth_facts(json.dumps(sequence.facts, sort_keys=True))
