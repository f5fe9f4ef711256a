"""The rigid baseline's fit: known motions come back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plop.geometry.rigid import kabsch, transform_points
from plop.metrics.chamfer import cd_mm, nearest_distances
from stages.eval.baselines import RigidFit, shifted


def motion(degrees: float, shift_mm: list[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0.0, 0.8])).as_matrix()
    pose[:3, 3] = np.array(shift_mm) / 1000
    return pose


@pytest.fixture
def block() -> np.ndarray:
    return (np.random.default_rng(0).random((600, 3)) - 0.5) * [0.1, 0.05, 0.08]


def test_kabsch_gives_the_motion_of_paired_points(block):
    pose = motion(50, [10, -20, 5])
    assert kabsch(block, transform_points(pose, block)) == pytest.approx(pose, abs=1e-12)


def test_kabsch_never_mirrors(block):
    flat = block * [1, 1, 0]
    assert np.linalg.det(kabsch(flat, flat * [-1, 1, 1])[:3, :3]) == pytest.approx(1)


def test_the_fit_finds_a_moderate_motion_of_the_unpaired_cloud(block):
    pose = motion(12, [6, -4, 8])
    target = transform_points(pose, block)[np.random.default_rng(1).permutation(600)]
    assert RigidFit(block).best(target, [np.eye(4)]) == pytest.approx(pose, abs=1e-6)


def test_the_fit_keeps_a_start_that_is_best(block):
    assert RigidFit(block).best(block, [shifted(np.array([0.05, 0, 0])), np.eye(4)]) == pytest.approx(
        np.eye(4), abs=1e-9
    )


def test_when_one_half_moves_far_the_fit_is_no_worse_than_standing_still(block):
    parted = block + np.where(block[:, :1] > 0, [0.02, 0, 0], 0)

    def distance(pose):
        return cd_mm(nearest_distances(transform_points(pose, block), parted))

    assert distance(RigidFit(block).best(parted, [np.eye(4)])) <= distance(np.eye(4))
