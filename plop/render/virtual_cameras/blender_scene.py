"""Render a mesh sequence inside Blender; this script runs there, not in plop, so it imports only bpy and numpy.

    blender --background --factory-startup --python blender_scene.py -- <scene.npz> <folder>
    python blender_scene.py -- <scene.npz> <folder>          with a Python that has bpy

Writes <folder>/<frame>_<camera>.png, frame and camera as numbers. Only colour is rendered here: depth and
labels come from plop's own ray caster, which is exact. `plop/render/virtual_cameras/blender.py` writes the npz.
"""

import sys
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

_BLENDER_FROM_OPENCV = Matrix(((1, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 0), (0, 0, 0, 1)))


def _material(name: str, *, colour: Any = None, attribute: str | None = None, roughness: float = 0.6) -> Any:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"]
    surface.inputs["Roughness"].default_value = roughness
    if attribute is None:
        surface.inputs["Base Color"].default_value = (*[float(value) for value in colour], 1.0)
    else:
        node = material.node_tree.nodes.new("ShaderNodeVertexColor")
        node.layer_name = attribute
        material.node_tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])
    return material


def _mesh(name: str, vertices: np.ndarray, faces: np.ndarray, material: Any, colours: np.ndarray | None = None) -> Any:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    if colours is not None:
        layer = mesh.color_attributes.new("colour", "FLOAT_COLOR", "POINT")
        rgba = np.concatenate([colours, np.ones((len(colours), 1))], axis=1).astype(np.float32)
        layer.data.foreach_set("color", rgba.reshape(-1))
    mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def _camera(intrinsics: np.ndarray, world_from_cam: np.ndarray, width: int, height: int) -> Any:
    """Make a camera; pixel centres are at half-integers, as everywhere in plop."""
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_width = "HORIZONTAL", 36.0
    lens.lens = 36.0 * float(intrinsics[0, 0]) / width
    lens.shift_x = (width / 2 - float(intrinsics[0, 2])) / width
    lens.shift_y = (float(intrinsics[1, 2]) - height / 2) / width
    lens.clip_start, lens.clip_end = 0.005, 20.0
    thing = bpy.data.objects.new("camera", lens)
    thing.matrix_world = Matrix(world_from_cam.tolist()) @ _BLENDER_FROM_OPENCV
    bpy.context.scene.collection.objects.link(thing)
    return thing


def _lights(ambient: float, directional: float, direction: Any) -> None:
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    background.inputs["Strength"].default_value = float(ambient)
    bpy.context.scene.world = world
    lamp = bpy.data.lights.new("lamp", "SUN")
    lamp.energy = float(directional) * np.pi
    lamp.angle = 0.1
    thing = bpy.data.objects.new("lamp", lamp)
    away = Matrix.Identity(3).col[2].rotation_difference(direction)
    thing.rotation_mode, thing.rotation_quaternion = "QUATERNION", away
    bpy.context.scene.collection.objects.link(thing)


def _settings(size: int, samples: int) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed = samples, 0
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.view_settings.view_transform = "Standard"


def main(path: str, folder: str) -> None:
    """Render every frame of every camera of `path` into `folder`."""
    from mathutils import Vector

    data = np.load(path, allow_pickle=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _settings(int(data["size"]), int(data["samples"]))
    _lights(data["ambient"], data["directional"], Vector(data["direction"].tolist()))
    skin = _material("object", attribute="colour", roughness=0.9)
    body = _mesh("object", data["vertices"][0], data["faces"], skin, data["colours"])
    steel = _material("tool", colour=data["tool_colour"], roughness=0.4)
    tool = _mesh("tool", data["tool_vertices"], data["tool_faces"], steel)
    if np.isfinite(data["table_z_m"]):
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 1.5 + [0, 0, float(data["table_z_m"])]
        _mesh("table", corners, np.array([[0, 1, 2, 3]]), _material("table", colour=data["table_colour"]))
    size = int(data["size"])
    cameras = [_camera(k, pose, size, size) for k, pose in zip(data["intrinsics"], data["world_from_cam"], strict=True)]
    for frame, vertices in enumerate(data["vertices"]):
        body.data.vertices.foreach_set("co", np.ascontiguousarray(vertices, np.float32).reshape(-1))
        body.data.update()
        tool.matrix_world = Matrix(data["world_from_tool"][frame].tolist())
        for index, camera in enumerate(cameras):
            bpy.context.scene.camera = camera
            bpy.context.scene.render.filepath = f"{folder}/{frame:04d}_{index:02d}.png"
            bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :][:2])
