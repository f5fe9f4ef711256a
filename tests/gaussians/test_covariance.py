import torch
from torch.testing import assert_close

from plop.gaussians.covariance import scales_quats_from_covariance
from plop.geometry.rigid import quat_to_matrix
from tests.gaussians.clouds import random_gaussians


def test_decomposition_gives_the_covariance_back():
    covariances = random_gaussians(200).covariances
    scales, quats = scales_quats_from_covariance(covariances)
    half = quat_to_matrix(quats) * scales[:, None, :]
    assert_close(half @ half.transpose(1, 2), covariances, rtol=1e-4, atol=1e-10)


def test_tiny_and_flat_covariances_stay_finite():
    flat = torch.diag(torch.tensor([1e-6, 1e-6, 0.0]))
    scales, quats = scales_quats_from_covariance(torch.stack([flat, torch.zeros(3, 3)]))
    assert torch.isfinite(scales).all() and (scales > 0).all()
    assert_close(quats.norm(dim=1), torch.ones(2))


def test_gradient_of_the_scales_is_that_of_the_eigenvalues_and_finite_where_they_meet():
    covariance = torch.diag(torch.tensor([1.0, 4.0, 9.0], dtype=torch.float64)).requires_grad_()
    scales, _ = scales_quats_from_covariance(covariance[None])
    (gradient,) = torch.autograd.grad(scales[0, 2], covariance)
    assert_close(gradient, torch.diag(torch.tensor([0.0, 0.0, 1 / 6], dtype=torch.float64)))  # d sqrt(9) = 1 / (2 * 3)

    equal = torch.eye(3, dtype=torch.float64).requires_grad_()
    scales, _ = scales_quats_from_covariance(equal[None])
    (gradient,) = torch.autograd.grad(scales.sum(), equal)
    assert_close(gradient, 0.5 * torch.eye(3, dtype=torch.float64))


def test_no_covariances_give_none():
    scales, quats = scales_quats_from_covariance(torch.zeros(0, 3, 3))
    assert scales.shape == (0, 3) and quats.shape == (0, 4)
