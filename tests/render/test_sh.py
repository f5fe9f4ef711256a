"""Laws of the spherical harmonics."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from plop.render.rasterizer.sh import sh_basis, sh_to_rgb


def test_basis_is_orthonormal_on_the_sphere():
    cosines, weights = np.polynomial.legendre.leggauss(8)
    angles = np.arange(16) * 2 * np.pi / 16
    sines = np.sqrt(1 - cosines**2)[:, None]
    x, y = sines * np.cos(angles), sines * np.sin(angles)
    z = np.broadcast_to(cosines[:, None], x.shape)
    values = sh_basis(torch.tensor(np.stack([x, y, z], axis=-1).reshape(-1, 3)), 16)
    area = torch.tensor(np.repeat(weights * 2 * np.pi / 16, 16))
    torch.testing.assert_close(values.T @ (area[:, None] * values), torch.eye(16, dtype=torch.float64))


def test_each_degree_spans_a_space_that_rotations_keep():
    directions = torch.tensor(np.random.default_rng(0).normal(size=(50, 3)))
    directions = torch.nn.functional.normalize(directions, dim=1)
    turned = directions @ torch.tensor(Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()).T
    for first, last in ((0, 1), (1, 4), (4, 9), (9, 16)):
        basis, other = sh_basis(directions, 16)[:, first:last], sh_basis(turned, 16)[:, first:last]
        fitted = basis @ torch.linalg.lstsq(basis, other).solution
        torch.testing.assert_close(fitted, other)


def test_colour_is_clamped_below_only():
    sh = torch.tensor([[[-4.0, 0.0, 4.0]]])
    rgb = sh_to_rgb(sh, torch.tensor([[0.0, 0.0, 1.0]]))
    torch.testing.assert_close(rgb, torch.tensor([[0.0, 0.5, 0.5 + 4 * 0.28209479177387814]]))
