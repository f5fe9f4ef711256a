"""Pictures for display: measured | predicted | distance between the surfaces, and | 90 % band, in the same colours.

They are larger than the recorded and scored images, and cropped to the object: predicted
Gaussians are rendered again, measured pixels are enlarged (plop.render.pictures.enlarge).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch

from plop.gaussians.state import Gaussians, concatenate
from plop.gaussians.trajectory import Trajectory
from plop.geometry.cameras import Camera
from plop.geometry.view import MaskLabel, View
from plop.metrics.surface_distance import distance_map_mm, scale_end_mm
from plop.recordings.recording import Recording
from plop.render.pictures.enlarge import Crop, enlarged, enlarged_mask, laid_over, resized
from plop.render.pictures.panels import PANEL, PANEL_PX, TOOL, Layout, Titles, distance_colours, millimetres
from plop.render.rasterizer.projection import LOW_PASS_PX2
from plop.render.rasterizer.rasterize import Backend, render
from plop.render.rasterizer.sh import C0
from plop.render.scene import tool_above_table
from plop.render.view_file import ViewFile

_MAP_PX = 192
"""Largest number of pixels along a side for computing distances, which are then enlarged like the measurement."""
_MAP_SMOOTH_PX = 0.8
"""Smoothing of a drawn distance: the nearest sample of a surface is up to half a pixel from the nearest point,
which causes a pattern. Printed numbers are not smoothed."""
_PHOTO_SMOOTH_PX = 0.45
"""Smoothing of a strongly enlarged photo [px of the recording]."""
_NOT_MEASURED = (120, 126, 135)
"""Colour of object pixels without a distance."""


class Comparison:
    """Draw frames of a rolled-out episode; crop and colour scale are the same for all frames.

    Args:
        recording: The measurement.
        views: Predicted views, at the cameras' own size.
        states: Predicted Gaussians, to render larger pictures; without them the predicted views are enlarged.
        tool: Gaussians of the tool in its own frame.
        camera: Name of the camera.
        frames: Frames that may be drawn; all when absent.
        backend: Renderer, see `plop.render.rasterizer.rasterize.render`.
        device: Device of the renderer.
    """

    def __init__(
        self,
        recording: Recording,
        views: ViewFile,
        states: Trajectory | None,
        tool: Gaussians,
        camera: str,
        *,
        frames: Sequence[int] | None = None,
        backend: Backend = "auto",
        device: torch.device | str = "cpu",
    ) -> None:
        self._recording, self._views, self._states, self._tool = recording, views, states, tool
        self._name, self._backend, self._device = camera, backend, device
        self.frames = list(range(len(recording)) if frames is None else frames)
        self._times, self._poses = recording.time_s, recording.world_from_tool
        first = recording.view(camera, self.frames[0])
        shown = [self._views.view(recording.camera(camera, frame), frame).object_mask for frame in self.frames]
        seen = [recording.mask(camera, frame) == MaskLabel.OBJECT for frame in self.frames]
        self._crop = Crop.around(seen + shown, PANEL_PX)
        self._maps = {frame: self._distances(frame) for frame in self.frames}
        self._banded = states is not None and states.has_extra("states", self.frames[0], "radius_m")
        bands = [self._radius_mm(frame) for frame in self.frames] if self._banded else []
        self._end_mm = scale_end_mm([*self._maps.values(), *bands], _footprint_mm(first, self._crop))
        drawn = "rendered at this size" if states is not None else None
        self._layout = _layout(first.camera, self._crop, self._end_mm, drawn, banded=self._banded)

    def picture(self, frame: int) -> np.ndarray:
        """Draw one frame; uint8, shape [H, W, 3], both sides even, the same for all frames."""
        measured, found = self._recording.view(self._name, frame), self._maps[frame]
        panels = [
            _photo(measured, self._crop),
            self._predicted(measured.camera, frame),
            _drawn_map(found, measured, self._crop, self._end_mm),
        ]
        when = f"t = {self._times[frame] - self._times[0]:.2f} s   frame {frame + 1} of {len(self._times)}"
        texts = [when, _short(self._name), _told(found)]
        if self._banded:
            radius = self._radius_mm(frame)
            panels.append(self._predicted(measured.camera, frame, distance_colours(radius, self._end_mm)))
            texts.append(f"mean {millimetres(float(radius.mean()))}")
        return self._layout.page(panels, texts)

    def telling_frame(self) -> int:
        """Return the frame with the largest mean distance of the surfaces; the last where no distance is known."""
        means = [(float(np.nanmean(found)), frame) for frame, found in self._maps.items() if np.isfinite(found).any()]
        return max(means)[1] if means else self.frames[-1]

    def _distances(self, frame: int) -> np.ndarray:
        names = self._recording.camera_names
        measured = [self._recording.view(name, frame) for name in names]
        predicted = [self._views.view(view.camera, frame) for view in measured]
        return distance_map_mm(measured, predicted, names.index(self._name), *self._crop.grid(_MAP_PX))

    def _radius_mm(self, frame: int) -> np.ndarray:
        """Radius of the band of each Gaussian."""
        assert self._states is not None
        return 1000 * self._states.extra("states", frame, "radius_m").numpy()

    @torch.no_grad()
    def _predicted(self, camera: Camera, frame: int, colours: np.ndarray | None = None) -> np.ndarray:
        """Render the prediction, with its own colours or with one for each Gaussian, [N, 3], and a grey tool."""
        if self._states is None:
            return _photo(self._views.view(camera, frame), self._crop)
        placed = tool_above_table(self._tool, self._poses[frame], self._recording.table_z_m)
        parts = [self._states.read("states", frame), placed.to("cpu")]
        if colours is not None:
            parts = [_painted(parts[0], colours), _painted(parts[1], np.array([TOOL]))]
        scene = concatenate(parts).to(self._device)
        behind = torch.tensor(PANEL, dtype=scene.means.dtype, device=self._device) / 255
        shown = self._crop.camera(camera)
        image = render(_as_scored(scene, camera, shown), shown, background=behind, backend=self._backend)
        return _bytes(255 * image.rgb.cpu().numpy())


def compared_views(measured: View, predicted: View) -> np.ndarray:
    """Compare one view with its prediction at the camera's own size.

    Args:
        measured: The measured view.
        predicted: The predicted view.

    Returns:
        The picture, uint8, shape [H, W, 3], both sides even.
    """
    crop = Crop.around([measured.object_mask, predicted.object_mask], PANEL_PX)
    found = distance_map_mm([measured], [predicted], 0, *crop.grid(_MAP_PX))
    end_mm = scale_end_mm([found], _footprint_mm(measured, crop))
    panels = _photo(measured, crop), _photo(predicted, crop), _drawn_map(found, measured, crop, end_mm)
    return _layout(measured.camera, crop, end_mm).page(panels, ("", _short(measured.camera.name), _told(found)))


def _photo(view: View, crop: Crop) -> np.ndarray:
    """Show a recorded image; if strongly enlarged, the steps of its pixels are smoothed."""
    part = crop.of(view.rgb).astype(np.float32)
    if crop.size[0] > 2 * crop.rows:
        part = cv2.GaussianBlur(part, (0, 0), _PHOTO_SMOOTH_PX, borderType=cv2.BORDER_REPLICATE)
    return _bytes(resized(part, crop.size))


def _drawn_map(distance_mm: np.ndarray, measured: View, crop: Crop, end_mm: float) -> np.ndarray:
    """Draw distances over the panel's grey, with the tool as it was measured."""
    known = np.isfinite(distance_mm)
    colours = distance_colours(enlarged(distance_mm, known, crop.size, smooth_px=_MAP_SMOOTH_PX), end_mm)
    layers = ((crop.of(measured.tool_mask), TOOL), (crop.of(measured.object_mask), _NOT_MEASURED), (known, colours))
    picture = np.empty((*crop.size, 3), np.float32)
    picture[:] = PANEL
    for mask, colour in layers:
        picture = laid_over(picture, np.asarray(colour, np.float32), enlarged_mask(mask, crop.size))
    return _bytes(picture)


def _painted(gaussians: Gaussians, colours: np.ndarray) -> Gaussians:
    """Replace colours, uint8, shape [N, 3] or [1, 3]."""
    painted = (torch.from_numpy(colours / 255).to(gaussians.sh) - 0.5) / C0
    return gaussians.with_(sh=painted.expand(len(gaussians), 3)[:, None])


def _layout(camera: Camera, crop: Crop, end_mm: float, drawn: str | None = None, *, banded: bool = False) -> Layout:
    """Choose titles; `drawn` describes the predicted picture, the same as the measured one when absent."""
    times = crop.size[0] / crop.rows
    shown = f"{camera.width} x {camera.height} px" + (f", enlarged {times:.1f} x" if times > 1.05 else "")
    titles = [
        Titles("measured", shown),
        Titles("predicted", drawn or shown),
        Titles("distance", "between the two surfaces"),
        *([Titles("90 % band", "radius, on the prediction")] if banded else []),
    ]
    return Layout(tuple(titles), crop.size, end_mm)


def _footprint_mm(view: View, crop: Crop) -> float:
    """Return the size of a pixel of the map at the object's depth, 0 where no depth was measured."""
    depth = view.depth_m[view.object_mask & (view.depth_m > 0)]
    return float(1000 * crop.step(_MAP_PX) * np.median(depth) / view.camera.intrinsics[0, 0]) if len(depth) else 0.0


def _short(name: str) -> str:
    return name if len(name) <= 32 else name[:29] + "..."


def _told(distance_mm: np.ndarray) -> str:
    known = distance_mm[np.isfinite(distance_mm)]
    if not len(known):
        return "no distance: no depth, or no object"
    return f"mean {millimetres(float(known.mean()))},  95 % below {millimetres(float(np.percentile(known, 95)))}"


def _as_scored(scene: Gaussians, recorded: Camera, shown: Camera) -> Gaussians:
    """Widen Gaussians by the low-pass filter of a camera's own pixels, so that finer pixels show the scored picture.

    Rendering adds LOW_PASS_PX2 to a Gaussian's variance in the image, which a fit includes; finer pixels add less.
    """
    pose = torch.as_tensor(recorded.cam_from_world).to(scene.means)
    depth = (scene.means @ pose[2, :3] + pose[2, 3]).clamp_min(0)
    focal = float(recorded.intrinsics[0, 0])
    missing_px2 = LOW_PASS_PX2 * max(0.0, 1 - (focal / float(shown.intrinsics[0, 0])) ** 2)
    width = missing_px2**0.5 * depth / focal
    return scene.with_(scales=(scene.scales.square() + width.square()[:, None]).sqrt())


def _bytes(picture: np.ndarray) -> np.ndarray:
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)
