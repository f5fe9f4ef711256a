"""Laws of the physical terms."""

from __future__ import annotations

import torch
from torch.testing import assert_close

from plop.dynamics.losses.physical import Neighbourhood, isometry, local_rotations, rigidity, rotation_similarity
from plop.geometry.rigid import matrix_to_quat, quat_from_rotation_vector, quat_multiply, quat_to_matrix

TURN = torch.tensor([0.1, -0.2, 0.3])


def turned(block):
    quat = quat_from_rotation_vector(TURN)
    means = block.means @ quat_to_matrix(quat).T + torch.tensor([0.01, 0.0, -0.02])
    return block.with_(means=means, quats=quat_multiply(quat.expand(len(block), 4), block.quats))


def test_rigid_motion_costs_nothing(block):
    pairs = Neighbourhood.of(block.means)
    after = turned(block)
    assert rigidity(pairs, block, after) < 1e-7
    assert rotation_similarity(pairs, block, after) < 1e-6
    assert isometry(pairs, after) < 1e-7


def test_a_stretch_costs_what_it_should(block):
    pairs = Neighbourhood.of(block.means)
    after = block.with_(means=block.means * 1.1)
    expected = (pairs.weight.sqrt() * 0.1 * pairs.rest_m).mean()
    assert_close(isometry(pairs, after), expected, rtol=1e-3, atol=1e-9)
    assert_close(rigidity(pairs, block, after), expected, rtol=1e-3, atol=1e-9)


def test_an_opened_cut_costs_nothing_once_severed(block):
    side = torch.sign(block.means[:, 0] - 0.03)
    pairs = Neighbourhood.of(block.means)
    opened = block.with_(means=block.means + 0.01 * side[:, None] * torch.tensor([1.0, 0.0, 0.0]))
    assert isometry(pairs, opened) > 1e-4
    assert isometry(pairs.severed(side), opened) < 1e-7


def test_pairs_follow_a_resampled_set(block):
    pairs = Neighbourhood.of(block.means)
    parents = torch.cat([torch.arange(10, len(block)), torch.tensor([20])])
    follow = pairs.following(parents)
    assert_close(
        block.means[parents][follow.first].sub(block.means[parents][follow.second]).norm(dim=-1),
        follow.rest_m,
        atol=1e-7,
        rtol=1e-4,
    )


def test_local_rotation_of_a_rigid_motion_is_the_rotation(block):
    pairs = Neighbourhood.of(block.means)
    found = matrix_to_quat(local_rotations(pairs, block.means, turned(block).means, len(block)))
    expected = quat_from_rotation_vector(TURN)
    # The identity mixed in for flat neighbourhoods pulls the angle back by about a fiftieth.
    assert (found - expected).norm(dim=-1).median() < 0.01
