import numpy as np

from plop.geometry.cameras import Camera, look_at
from plop.geometry.depth_planes import pixel_planes
from tests.support.ellipsoid_scene import ellipsoid_distance, render, ring


def roof(noise_m: float = 0.0) -> tuple[Camera, np.ndarray, np.ndarray]:
    """A ridge seen from above: two planes at 90 degrees that meet where x = 0; normals [H, W, 3]."""
    pose = look_at(np.array([0.002, 0.0, 0.3]), np.array([0.002, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    camera = Camera("above", 64, 64, np.array([[80.0, 0, 32], [0, 80, 32], [0, 0, 1]]), pose)
    rays = camera.pixel_directions() @ camera.world_from_cam[:3, :3].T
    eye = camera.world_from_cam[:3, 3]
    sides = np.array([[1.0, 0, 1], [-1, 0, 1]]) / np.sqrt(2)
    depths = np.stack([-(eye @ side) / (rays @ side) for side in sides])
    side = depths.argmax(0)
    depth = depths.max(0) + np.random.default_rng(0).normal(0, noise_m, side.shape)
    return camera, depth.astype(np.float32), sides[side]


def test_planes_end_at_a_crease():
    camera, depth, normals = roof()
    planes = pixel_planes(camera, depth, np.ones(depth.shape, bool))
    inner = (slice(2, -2), slice(2, -2))
    assert (planes.facing[inner] > 0.35).all()
    assert (planes.normals * normals).sum(-1)[inner].min() > 0.999, "also in the pixels beside the ridge"


def test_noise_is_averaged():
    camera, depth, _ = roof(noise_m=3e-4)
    planes = pixel_planes(camera, depth, np.ones(depth.shape, bool))
    off = np.abs(np.abs(planes.points[..., 0]) + planes.points[..., 2]) / np.sqrt(2)
    measured = camera.back_project(depth).reshape(planes.points.shape)
    before = np.abs(np.abs(measured[..., 0]) + measured[..., 2]) / np.sqrt(2)
    use = planes.facing > 0.25
    assert use.mean() > 0.9
    assert np.sqrt((off[use] ** 2).mean()) < 0.8 * np.sqrt((before[use] ** 2).mean())


def test_what_was_not_measured_has_no_plane():
    camera = ring(1, 64)[0]
    _, depth, mask = render(camera)
    depth = np.where(np.arange(64)[:, None] % 8 < 3, 0, depth)
    depth[0, 0] = np.nan
    planes = pixel_planes(camera, depth, mask == 1)
    assert not planes.facing[(depth == 0) | (mask != 1)].any()
    seen = planes.facing > 0.3
    assert seen.sum() > 150 and np.abs(ellipsoid_distance(planes.points[seen])).max() < 5e-4


def test_a_lone_pixel_and_an_empty_image_give_none():
    camera = ring(1, 32)[0]
    depth = np.zeros((32, 32), np.float32)
    assert not pixel_planes(camera, depth, depth == 0).facing.any()
    depth[5, 5] = 0.3
    assert not pixel_planes(camera, depth, depth > 0).facing.any()
