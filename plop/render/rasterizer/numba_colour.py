"""Kernels: colour of every Gaussian from spherical harmonics, and its gradient; parallel over Gaussians.

The same maths as `plop.render.rasterizer.sh`, in float32.
"""

from __future__ import annotations

import math

import numpy as np

from plop.compute.cpu_kernels import kernel
from plop.render.rasterizer.sh import C0, C1, C2, C3

_C0, _C1 = np.float32(C0), np.float32(C1)
_C20, _C21, _C22 = (np.float32(c) for c in C2)
_C30, _C31, _C32, _C33, _C34 = (np.float32(c) for c in C3)
_HALF, _ZERO = np.float32(0.5), np.float32(0)
_2, _3, _4, _6, _8 = (np.float32(c) for c in (2, 3, 4, 6, 8))


@kernel
def _direction(mean, view, eye):  # type: ignore[no-untyped-def]
    """Return the unit vector from the eye to the mean, and the inverse of the distance."""
    x, y, z = mean[0] - view[eye], mean[1] - view[eye + 1], mean[2] - view[eye + 2]
    inverse = 1.0 / max(math.sqrt(x * x + y * y + z * z), 1e-12)
    return np.float32(x * inverse), np.float32(y * inverse), np.float32(z * inverse), np.float32(inverse)


@kernel
def _basis(x, y, z, terms, basis):  # type: ignore[no-untyped-def]
    """Write the first `terms` basis functions at a unit vector."""
    basis[0] = _C0
    if terms > 1:
        basis[1], basis[2], basis[3] = -_C1 * y, _C1 * z, -_C1 * x
    if terms > 4:
        basis[4] = _C20 * x * y
        basis[5] = -_C20 * y * z
        basis[6] = _C21 * (_2 * z * z - x * x - y * y)
        basis[7] = -_C20 * x * z
        basis[8] = _C22 * (x * x - y * y)
    if terms > 9:
        basis[9] = -_C30 * y * (_3 * x * x - y * y)
        basis[10] = _C31 * x * y * z
        basis[11] = -_C32 * y * (_4 * z * z - x * x - y * y)
        basis[12] = _C33 * z * (_2 * z * z - _3 * x * x - _3 * y * y)
        basis[13] = -_C32 * x * (_4 * z * z - x * x - y * y)
        basis[14] = _C34 * z * (x * x - y * y)
        basis[15] = -_C30 * x * (x * x - _3 * y * y)


@kernel
def _basis_backward(x, y, z, terms, d):  # type: ignore[no-untyped-def]
    """Return the gradient of the direction from the gradients `d` of the basis functions."""
    d_x, d_y, d_z = -_C1 * d[3], -_C1 * d[1], _C1 * d[2]
    if terms > 4:
        d_x += _C20 * (y * d[4] - z * d[7]) - _2 * _C21 * x * d[6] + _2 * _C22 * x * d[8]
        d_y += _C20 * (x * d[4] - z * d[5]) - _2 * _C21 * y * d[6] - _2 * _C22 * y * d[8]
        d_z += _4 * _C21 * z * d[6] - _C20 * (y * d[5] + x * d[7])
    if terms > 9:
        xx, yy, zz = x * x, y * y, z * z
        d_x += -_C30 * (_6 * x * y * d[9] + _3 * (xx - yy) * d[15]) + _C31 * y * z * d[10]
        d_x += _C32 * (_2 * x * y * d[11] - (_4 * zz - _3 * xx - yy) * d[13])
        d_x += -_6 * _C33 * x * z * d[12] + _2 * _C34 * x * z * d[14]
        d_y += _C30 * (_6 * x * y * d[15] - _3 * (xx - yy) * d[9]) + _C31 * x * z * d[10]
        d_y += _C32 * (_2 * x * y * d[13] - (_4 * zz - xx - _3 * yy) * d[11])
        d_y += -_6 * _C33 * y * z * d[12] - _2 * _C34 * y * z * d[14]
        d_z += _C31 * x * y * d[10] - _8 * _C32 * z * (y * d[11] + x * d[13])
        d_z += _C33 * (_6 * zz - _3 * xx - _3 * yy) * d[12] + _C34 * (xx - yy) * d[14]
    return d_x, d_y, d_z


@kernel
def colour_forward(part, parts, means, sh, views, eye, boxes, splats):  # type: ignore[no-untyped-def]
    """Write r, g, b of every drawn splat.

    Args:
        part: Index of the share of the Gaussians to process.
        parts: Number of shares.
        means: Shape [N, 3], float32 [m].
        sh: Shape [N, K, 3], float32.
        views: Packed cameras, float64, one per row.
        eye: Column of `views` where the camera's position starts.
        boxes: Which splats are drawn (`project_forward`).
        splats: In and out, shape [V, N, 10].
    """
    count, terms = sh.shape[0], sh.shape[1]
    basis = np.zeros(16, np.float32)
    for g in range(count * part // parts, count * (part + 1) // parts):
        for v in range(views.shape[0]):
            if boxes[v, g, 1] == 0:
                continue
            x, y, z, _ = _direction(means[g], views[v], eye)
            _basis(x, y, z, terms, basis)
            for c in range(3):
                value = _HALF
                for k in range(terms):
                    value += basis[k] * sh[g, k, c]
                splats[v, g, 6 + c] = max(value, _ZERO)


@kernel
def colour_backward(part, parts, means, sh, views, eye, boxes, splats, grads, d_means, d_sh):  # type: ignore[no-untyped-def]
    """Add the gradient of colours (columns 6 to 8 of `grads` [V, N, 10]) to `d_means` and `d_sh`."""
    count, terms = sh.shape[0], sh.shape[1]
    basis, d_basis, d_rgb = np.zeros(16, np.float32), np.zeros(16, np.float32), np.zeros(3, np.float32)
    for g in range(count * part // parts, count * (part + 1) // parts):
        for v in range(views.shape[0]):
            if boxes[v, g, 1] == 0:
                continue
            x, y, z, inverse = _direction(means[g], views[v], eye)
            _basis(x, y, z, terms, basis)
            for c in range(3):
                d_rgb[c] = grads[v, g, 6 + c] if splats[v, g, 6 + c] > _ZERO else _ZERO
            for k in range(terms):
                d_basis[k] = _ZERO
                for c in range(3):
                    d_basis[k] += sh[g, k, c] * d_rgb[c]
                    d_sh[g, k, c] += basis[k] * d_rgb[c]
            if terms > 1:
                d_x, d_y, d_z = _basis_backward(x, y, z, terms, d_basis)
                along = x * d_x + y * d_y + z * d_z
                d_means[g, 0] += (d_x - x * along) * inverse
                d_means[g, 1] += (d_y - y * along) * inverse
                d_means[g, 2] += (d_z - z * along) * inverse
