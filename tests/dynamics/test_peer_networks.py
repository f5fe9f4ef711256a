"""The peers' networks and their parts: symmetries, gradients, and a second implementation of each."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.testing import assert_close

from benchmarks.peers.dense import DensePropagationNetwork
from plop.dynamics.peers import edges
from plop.dynamics.peers.edges import Edges, radius_edges
from plop.dynamics.peers.propagation import PropagationNetwork
from plop.dynamics.peers.sampling import farthest_points
from plop.dynamics.peers.skinning import local_turns, skin_weights, skinned
from plop.dynamics.peers.transformer import ParticleTransformer
from plop.geometry.rigid import quat_to_matrix

OBJECTS, TOOL, INPUTS, RADIUS = 30, 9, 5, 0.4


def particles(seed: int = 0, dtype: torch.dtype = torch.float32) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.rand(OBJECTS + TOOL, 3, generator=generator, dtype=dtype)
    return positions, torch.randn(OBJECTS + TOOL, INPUTS, generator=generator, dtype=dtype)


def graph_network(kind: type[PropagationNetwork] = PropagationNetwork) -> PropagationNetwork:
    torch.manual_seed(1)
    network = kind(INPUTS, width=16, propagations=3)
    torch.nn.init.normal_(network.decode[-1].weight)
    return network


def transformer() -> ParticleTransformer:
    torch.manual_seed(1)
    network = ParticleTransformer(INPUTS, width=16, layers=2, heads=4)
    torch.nn.init.normal_(network.decode[-1].weight)
    return network


def permuted(order: torch.Tensor, edges: Edges) -> Edges:
    place = torch.argsort(order)
    return Edges(place[edges.senders], place[edges.receivers])


def test_the_index_form_equals_the_dense_form_forward_and_backward():
    positions, features = particles()
    edges = radius_edges(positions, OBJECTS, RADIUS, 6)
    found = []
    for kind in (PropagationNetwork, DensePropagationNetwork):
        network = graph_network(kind)
        out = network(positions, features, edges)
        out.square().sum().backward()
        found.append([out.detach(), *(weight.grad for weight in network.parameters())])
    for one, other in zip(*found, strict=True):
        assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_the_graph_network_knows_no_place_and_no_order():
    (positions, features), network = particles(), graph_network()
    edges = radius_edges(positions, OBJECTS, RADIUS, 6)
    out = network(positions, features, edges)
    assert_close(network(positions + torch.tensor([3.0, -1.0, 2.0]), features, edges), out, rtol=1e-3, atol=1e-4)
    order = torch.randperm(len(positions), generator=torch.Generator().manual_seed(2))
    again = network(positions[order], features[order], permuted(order, edges))
    assert_close(again, out[order], rtol=1e-4, atol=1e-5)
    mirrored = network(-positions, features, edges)
    assert not torch.allclose(mirrored, out, atol=1e-3)  # it does know directions


def test_an_effect_travels_one_edge_in_a_step():
    """In a chain of particles the last one feels the first one only after as many steps as there are edges."""
    chain = torch.zeros(5, 3)
    chain[:, 0] = torch.arange(5)
    edges = radius_edges(chain, 5, 1.1, 2)
    both_ways = sorted({(i, i + 1) for i in range(4)} | {(i + 1, i) for i in range(4)})
    assert sorted(zip(edges.senders.tolist(), edges.receivers.tolist(), strict=True)) == both_ways
    for steps, feels in ((2, False), (4, True)):
        torch.manual_seed(0)
        network = PropagationNetwork(INPUTS, width=16, propagations=steps)
        features = torch.randn(5, INPUTS).requires_grad_()
        # encoding an edge reads both of its ends, one edge more
        (grad,) = torch.autograd.grad(network(chain, features, edges)[4].sum(), features)
        assert bool(grad[0].abs().sum() > 0) == feels


def test_the_transformer_knows_no_order_and_sees_every_particle():
    (positions, features), network = particles(), transformer()
    order = torch.randperm(len(positions), generator=torch.Generator().manual_seed(2))
    out = network(positions, features)
    assert_close(network(positions[order], features[order]), out[order], rtol=1e-4, atol=1e-5)
    features.requires_grad_()
    (grad,) = torch.autograd.grad(network(positions, features)[0].sum(), features)
    assert (grad.abs().sum(1) > 0).all()


def test_attention_in_parts_is_the_whole_attention(monkeypatch):
    (positions, features), network = particles(), transformer()
    out = network(positions, features)
    monkeypatch.setattr("plop.dynamics.peers.transformer._QUERIES", 7)
    assert_close(network(positions, features), out, rtol=1e-5, atol=1e-6)


def test_attention_is_that_of_the_paper():
    block, tokens = transformer().blocks[0], torch.randn(11, 16)
    query, key, value = (part.reshape(11, 4, 4) for part in block.joint(block.before_attention(tokens)).chunk(3, 1))
    shares = torch.softmax(torch.einsum("phc,qhc->hpq", query, key) / 2, -1)
    mixed = tokens + block.joined(torch.einsum("hpq,qhc->phc", shares, value).reshape(11, 16))
    assert_close(block(tokens), mixed + block.feed(block.before_feed(mixed)), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["graph", "transformer"])
def test_gradients_are_those_of_finite_differences(name):
    positions, features = particles(dtype=torch.float64)
    edges = radius_edges(positions, OBJECTS, RADIUS, 4)
    network = (graph_network() if name == "graph" else transformer()).double()
    more = (edges,) if name == "graph" else ()
    direction = torch.randn(len(positions), 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)

    def loss(at: torch.Tensor) -> torch.Tensor:
        return (network(at, features, *more) * direction).sum()

    start = positions.clone().requires_grad_()
    (grad,) = torch.autograd.grad(loss(start), start)
    way, small = torch.randn(positions.shape, generator=torch.Generator().manual_seed(4), dtype=torch.float64), 1e-7
    slope = (loss(positions + small * way) - loss(positions - small * way)) / (2 * small)
    assert float((grad * way).sum().detach()) == pytest.approx(float(slope.detach()), rel=1e-4)


@pytest.mark.parametrize("most", [0, 3])
def test_edges_are_those_of_a_search_by_hand(most):
    positions, _ = particles()
    points = positions.double().numpy()
    expected = set()
    for i in range(OBJECTS):
        for senders in (range(OBJECTS), range(OBJECTS, OBJECTS + TOOL)):
            near = sorted((np.linalg.norm(points[i] - points[j]), j) for j in senders if j != i)
            near = [(d, j) for d, j in near if d <= RADIUS]
            expected |= {(j, i) for _, j in (near[:most] if most else near)}
    edges = radius_edges(positions, OBJECTS, RADIUS, most)
    found = list(zip(edges.senders.tolist(), edges.receivers.tolist(), strict=True))
    assert len(found) == len(set(found)) and set(found) == expected
    assert max(edges.receivers.tolist()) < OBJECTS


def test_particles_without_neighbours_have_no_edges():
    apart = torch.tensor([[0.0, 0, 0], [5.0, 0, 0], [9.0, 0, 0]])
    for most in (0, 4):
        assert len(radius_edges(apart, 2, 1.0, most).senders) == 0
    assert graph_network()(apart, torch.zeros(3, INPUTS), radius_edges(apart, 2, 1.0, 4)).shape == (3, 3)


@pytest.mark.parametrize("most", [0, 3])
def test_comparing_all_pairs_finds_the_edges_of_the_tree(most, monkeypatch):
    """The search of a GPU, in parts; on the CPU it can be compared."""
    inner, outer = torch.rand(40, 3), torch.rand(12, 3)
    monkeypatch.setattr(edges, "_PAIRS", 100)
    for other, own in ((inner, True), (outer, False)):
        tree, pairs = (
            {*zip(*(each.tolist() for each in search(inner, other, 0.3, most, own=own)), strict=True)}
            for search in (edges._in_tree, edges._compared)
        )
        assert tree == pairs and tree
    assert len(edges._compared(inner[:0], outer, 0.3, most, own=False)[0]) == 0


def test_sampled_points_cover_the_cloud():
    cloud, _ = particles()
    chosen = farthest_points(cloud, 8)
    gaps = torch.cdist(cloud[chosen], cloud[chosen]).fill_diagonal_(9)
    # Each is at least as far from the others as any point is from all of them: the definition of the method.
    assert float(torch.cdist(cloud, cloud[chosen[:-1]]).amin(1).max()) == pytest.approx(
        float(gaps[-1, :-1].min()), rel=1e-5
    )
    assert len(set(chosen.tolist())) == 8
    order = torch.randperm(len(cloud), generator=torch.Generator().manual_seed(0))
    assert torch.equal(order[farthest_points(cloud[order], 8)], chosen)
    assert farthest_points(cloud, 0).tolist() == farthest_points(cloud, 99).tolist() == list(range(len(cloud)))


def test_a_rigid_motion_is_skinned_exactly():
    generator = torch.Generator().manual_seed(0)
    points = 0.08 * torch.rand(200, 3, generator=generator, dtype=torch.float64)
    turn = torch.from_numpy(Rotation.from_rotvec([0.2, -0.3, 0.25]).as_matrix())
    after = points @ turn.T + torch.tensor([0.01, 0.0, -0.02])
    bones = farthest_points(points, 20)
    turns = local_turns(points[bones], after[bones])
    assert_close(quat_to_matrix(turns), turn.expand(20, 3, 3), rtol=0, atol=1e-9)
    for count in (0, 4):
        weights = skin_weights(points, points[bones], count)
        assert_close(weights.sum(1), torch.ones(200).double())
        assert int((weights > 0).sum(1).max()) == (count or 20)
        found, quats = skinned(points, points[bones], after[bones], turns, weights)
        assert_close(found, after, rtol=0, atol=1e-10)
        assert_close(quat_to_matrix(quats), turn.expand(200, 3, 3), rtol=0, atol=1e-9)


def test_the_gradient_of_a_fitted_rotation_is_exact():
    generator = torch.Generator().manual_seed(0)
    before = torch.rand(9, 3, generator=generator, dtype=torch.float64)
    after = before + 0.05 * torch.randn(9, 3, generator=generator, dtype=torch.float64)
    direction, way = (torch.randn(9, n, generator=generator, dtype=torch.float64) for n in (4, 3))

    def loss(at: torch.Tensor) -> torch.Tensor:
        return (local_turns(before, at) * direction).sum()

    start = after.clone().requires_grad_()
    (grad,) = torch.autograd.grad(loss(start), start)
    slope = (loss(after + 1e-6 * way) - loss(after - 1e-6 * way)) / 2e-6
    # The gradient is regularised by a thousandth.
    assert float((grad * way).sum().detach()) == pytest.approx(float(slope.detach()), rel=5e-3)


def test_points_on_a_line_and_few_points_have_finite_rotations():
    line = torch.zeros(8, 3)
    line[:, 0] = torch.linspace(0, 0.1, 8)
    moved = line.clone().requires_grad_()
    local_turns(line, moved).square().sum().backward()
    assert torch.isfinite(moved.grad).all()
    assert torch.equal(local_turns(line[:2], line[:2] + 1), torch.tensor([[1.0, 0, 0, 0]]).expand(2, 4))
