"""Measures of one particle's strain in closed form, shared by the kernels of effects."""

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False

from __future__ import annotations

import math

import numpy as np
from numba import njit

from plop.physics.engine.kernels.elastic import determinant
from plop.physics.engine.kernels.transfer import row_major

_ZERO = np.float32(0)
_ONE = np.float32(1)
_THREE = np.float32(3)
_THIRD = np.float32(1 / 3)
_HALF = np.float32(0.5)
_SMALLEST_J = np.float32(0.05)
_SWEEPS = 5


@njit(fastmath=True)
def left_cauchy_green(f, p):
    """Compute b = F F^T of particle p of an array [N, 3, 3]: xx, yy, zz, xy, xz, yz."""
    a, b, c, d, e, g, h, i, j = row_major(f, p)
    return (
        a * a + b * b + c * c,
        d * d + e * e + g * g,
        h * h + i * i + j * j,
        a * d + b * e + c * g,
        a * h + b * i + c * j,
        d * h + e * i + g * j,
    )


@njit(fastmath=True)
def isochoric_strain(f, p):
    """Return the shear measure I1 J^(-2/3) - 3 of a particle, and the factor J^(-2/3); 0 and 1 at rest."""
    xx, yy, zz, _, _, _ = left_cauchy_green(f, p)
    j = max(determinant(*row_major(f, p)), _SMALLEST_J)
    scale = math.exp(-(_THIRD + _THIRD) * math.log(j))
    return max(_ZERO, scale * (xx + yy + zz) - _THREE), scale


@njit(fastmath=True)
def add_deviator(extra, p, factor, xx, yy, zz, xy, xz, yz):
    """Add `factor` times the deviator of a symmetric matrix to row p of an array [N, 6]."""
    mean = (xx + yy + zz) * _THIRD
    extra[p, 0] += factor * (xx - mean)
    extra[p, 1] += factor * (yy - mean)
    extra[p, 2] += factor * (zz - mean)
    extra[p, 3] += factor * xy
    extra[p, 4] += factor * xz
    extra[p, 5] += factor * yz


@njit(fastmath=True)
def rotate_pair(a, v, i, j):
    """One Jacobi rotation: make a[i, j] of a symmetric matrix 0, keep its eigenvectors in the columns of v."""
    if abs(a[i, j]) <= np.float32(1e-9):
        return
    theta = (a[j, j] - a[i, i]) / (a[i, j] + a[i, j])
    t = _ONE / (abs(theta) + math.sqrt(theta * theta + _ONE))
    if theta < _ZERO:
        t = -t
    c = _ONE / math.sqrt(t * t + _ONE)
    s = t * c
    for k in range(3):
        x, y = a[k, i], a[k, j]
        a[k, i], a[k, j] = c * x - s * y, s * x + c * y
    for k in range(3):
        x, y = a[i, k], a[j, k]
        a[i, k], a[j, k] = c * x - s * y, s * x + c * y
    for k in range(3):
        x, y = v[k, i], v[k, j]
        v[k, i], v[k, j] = c * x - s * y, s * x + c * y


@njit(fastmath=True)
def eigen_symmetric(xx, yy, zz, xy, xz, yz, a, v):
    """Eigenvalues (on the diagonal of a) and eigenvectors (columns of v) by Jacobi's method; a, v [3, 3] are written.

    Source: Golub & Van Loan, Matrix Computations, ch. 8. Five sweeps reach float32 precision.
    """
    a[0, 0], a[1, 1], a[2, 2] = xx, yy, zz
    a[0, 1], a[0, 2], a[1, 2] = xy, xz, yz
    a[1, 0], a[2, 0], a[2, 1] = xy, xz, yz
    for i in range(3):
        for j in range(3):
            v[i, j] = _ONE if i == j else _ZERO
    for _ in range(_SWEEPS):
        rotate_pair(a, v, 0, 1)
        rotate_pair(a, v, 0, 2)
        rotate_pair(a, v, 1, 2)
