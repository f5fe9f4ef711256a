"""Colour by Blender's Cycles, run as a process of its own with its own Python packages.

plop never imports bpy: it needs an older numpy. The scene is passed as one npz file, the images are
read as PNG. Depth and labels are those of `MeshRenderer`, whose rays go through the pixel centres.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from PIL import Image

from plop.errors import PlopError
from plop.geometry.cameras import Camera
from plop.geometry.view import View
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.render.virtual_cameras.mesh_raycast import Look

_SCRIPT = Path(__file__).with_name("blender_scene.py")
_GET_IT = (
    "Install Blender 4 or 5, or create a virtual environment with `pip install bpy`, and set its executable "
    "or its python with --cameras.blender; or use --cameras.renderer raycast."
)


def blender_command(executable: str, scene: Path, folder: Path) -> list[str]:
    """Build the command that renders a scene file.

    Args:
        executable: Blender itself, or a Python that has bpy (its file name starts with "python").
        scene: The npz file.
        folder: Folder of the images.

    Raises:
        PlopError: There is no such executable.
    """
    found = shutil.which(executable)
    if found is None:
        raise PlopError(
            "Blender is not found.",
            where=f"--cameras.blender {executable}",
            expected="Blender or a Python with bpy",
            found="no such executable",
            fix=_GET_IT,
        )
    is_python = Path(found).name.startswith("python")
    options = [] if is_python else ["--background", "--factory-startup", "--python"]
    return [found, *options, str(_SCRIPT), "--", str(scene), str(folder)]


def subdivided(sequence: MeshSequence, look: Look, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide every triangle into parts^2, so that vertex colours resolve the texture.

    Args:
        sequence: The episode.
        look: Its colours.
        parts: Number of parts of each edge.

    Returns:
        Vertices [T, K, 3] m, faces [L, 3], linear colours [K, 3]; no vertex is shared between triangles of the input.
    """
    grid = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    index = {key: position for position, key in enumerate(grid)}
    weights = np.array([(parts - i - j, i, j) for i, j in grid]) / parts
    small = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in grid if i + j < parts]
    small += [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in grid if i + j < parts - 1]
    offsets = np.arange(len(sequence.faces))[:, None, None] * len(grid)
    faces = (np.array(small)[None] + offsets).reshape(-1, 3)
    vertices = np.einsum("kc,tfcd->tfkd", weights, sequence.vertices[:, sequence.faces])
    rest = np.einsum("kc,fcd->fkd", weights, sequence.rest[sequence.faces]).reshape(-1, 3)
    colours = look.texture.colour(rest, np.repeat(sequence.is_cut_face, len(grid)))
    return vertices.reshape(len(sequence), -1, 3).astype(np.float32), faces, _linear(colours)


def _linear(srgb: np.ndarray | Sequence[float]) -> np.ndarray:
    """Undo the sRGB curve that Blender applies to its output."""
    value = np.asarray(srgb, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


class BlenderRenderer:
    """Colour images of one episode; use as a context manager, the images live in a temporary folder.

    Args:
        sequence: The episode.
        look: Colours.
        cameras: Fixed cameras, all of one size.
        executable: Blender, or a Python that has bpy.
        samples: Cycles samples per pixel.
        parts: Number of parts of each edge of the mesh.

    Raises:
        PlopError: Blender is not found, or it failed.
    """

    def __init__(
        self,
        sequence: MeshSequence,
        look: Look,
        cameras: Sequence[Camera],
        *,
        executable: str,
        samples: int = 16,
        parts: int = 5,
    ) -> None:
        self._index = {camera.name: position for position, camera in enumerate(cameras)}
        self._folder = tempfile.TemporaryDirectory(prefix="plop_blender_")
        folder = Path(self._folder.name)
        command = blender_command(executable, folder / "scene.npz", folder)
        _write_scene(folder / "scene.npz", sequence, look, cameras, samples, parts)
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        images = len(list(folder.glob("*.png")))
        if done.returncode != 0 or images != len(sequence) * len(cameras):
            last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-3:]
            self._folder.cleanup()
            raise PlopError(
                "Blender failed.",
                where=sequence.name,
                expected=f"{len(sequence) * len(cameras)} images",
                found=f"{images} images, exit code {done.returncode}: {' | '.join(last)}",
                fix=_GET_IT,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def recolour(self, view: View, frame: int) -> View:
        """Replace the colour of a ray-cast view by Blender's; depth and labels are kept."""
        name = f"{frame:04d}_{self._index[view.camera.name]:02d}.png"
        return replace(view, rgb=read_picture(Path(self._folder.name) / name))


def read_picture(path: Path) -> np.ndarray:
    """Read a PNG of Blender's, without its alpha, as uint8, shape [H, W, 3]."""
    with Image.open(path) as picture:
        return np.array(picture)[..., :3]


def _write_scene(
    path: Path, sequence: MeshSequence, look: Look, cameras: Sequence[Camera], samples: int, parts: int
) -> None:
    vertices, faces, colours = subdivided(sequence, look, parts)
    arrays: dict[str, Any] = {
        "vertices": vertices,
        "faces": faces,
        "colours": colours,
        "tool_vertices": sequence.tool_vertices,
        "tool_faces": sequence.tool_faces,
        "world_from_tool": sequence.world_from_tool,
        "table_z_m": np.nan if sequence.table_z_m is None else sequence.table_z_m,
        "tool_colour": _linear(look.tool),
        "table_colour": _linear(look.table),
        "ambient": look.light.ambient,
        "directional": look.light.directional,
        "direction": look.light.direction,
        "intrinsics": np.stack([camera.intrinsics for camera in cameras]),
        "world_from_cam": np.stack([camera.world_from_cam for camera in cameras]),
        "size": cameras[0].width,
        "samples": samples,
    }
    with path.open("wb") as file:
        np.savez(file, **arrays)
