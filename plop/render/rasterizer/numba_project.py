"""Kernels: project Gaussians to splats, and propagate the gradient of splats back; parallel over Gaussians.

A splat is ten float32: mean x, mean y [px] from the corner of its box of pixels (nearer than the corner
of the image, so finer), conic xx, xy, yy [1/px^2], opacity, r, g, b, depth [m].
Its gradient arrives as ten sums over pixels of (G, G dx, G dy, G dx^2, G dx dy, G dy^2, and the
gradients of r, g, b, depth), where G = alpha dL/dalpha and (dx, dy) = pixel - mean.
The maths is that of `plop.render.rasterizer.projection`, in float64 within a Gaussian.
"""

from __future__ import annotations

import math

import numpy as np

from plop.compute.cpu_kernels import kernel
from plop.render.rasterizer.projection import ALPHA_MIN, LOW_PASS_PX2

SPLAT = 10
"""Numbers per splat and per gradient of a splat."""
POSE, FOCAL, CENTRE, LIMITS, EYE, NEAR, VIEW = 0, 12, 14, 16, 20, 23, 24
"""Offsets in a packed view: cam_from_world (3x4), fx fy, cx cy, Jacobian limits, eye, near plane; its length."""


@kernel
def _rotation(quat, rotation):  # type: ignore[no-untyped-def]
    """Write the rotation matrix of a quaternion of any length; return 1 / length and the unit quaternion."""
    w, x, y, z = float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])
    inverse = 1.0 / max(math.sqrt(w * w + x * x + y * y + z * z), 1e-12)
    w, x, y, z = w * inverse, x * inverse, y * inverse, z * inverse
    rotation[0, 0] = 1 - 2 * (y * y + z * z)
    rotation[0, 1] = 2 * (x * y - w * z)
    rotation[0, 2] = 2 * (x * z + w * y)
    rotation[1, 0] = 2 * (x * y + w * z)
    rotation[1, 1] = 1 - 2 * (x * x + z * z)
    rotation[1, 2] = 2 * (y * z - w * x)
    rotation[2, 0] = 2 * (x * z - w * y)
    rotation[2, 1] = 2 * (y * z + w * x)
    rotation[2, 2] = 1 - 2 * (x * x + y * y)
    return inverse, w, x, y, z


@kernel
def _to_camera(mean, view):  # type: ignore[no-untyped-def]
    """Move a world point into the camera frame."""
    a, b, c = float(mean[0]), float(mean[1]), float(mean[2])
    x = view[0] * a + view[1] * b + view[2] * c + view[3]
    y = view[4] * a + view[5] * b + view[6] * c + view[7]
    z = view[8] * a + view[9] * b + view[10] * c + view[11]
    return x, y, z


@kernel
def _image_axes(axes, view, z, x_over_z, y_over_z, turned, image):  # type: ignore[no-untyped-def]
    """Write the Gaussian's axes in the camera frame (turned, 3x3) and in the image (2x3)."""
    for i in range(3):
        for k in range(3):
            turned[i, k] = view[4 * i] * axes[0, k] + view[4 * i + 1] * axes[1, k] + view[4 * i + 2] * axes[2, k]
    scale_x, scale_y = view[FOCAL] / z, view[FOCAL + 1] / z
    for k in range(3):
        image[0, k] = scale_x * (turned[0, k] - x_over_z * turned[2, k])
        image[1, k] = scale_y * (turned[1, k] - y_over_z * turned[2, k])


@kernel
def _project_one(mean, opacity, view, width, height, axes, turned, image, splat, box):  # type: ignore[no-untyped-def]
    """Write one splat and the box of pixels (x0, x1, y0, y1) it reaches, empty if not drawn; return its depth."""
    box[:] = 0
    x, y, z = _to_camera(mean, view)
    if z <= view[NEAR] or opacity < ALPHA_MIN:
        return z
    x_over_z, y_over_z = x / z, y / z
    limited_x = min(max(x_over_z, view[LIMITS]), view[LIMITS + 1])
    limited_y = min(max(y_over_z, view[LIMITS + 2]), view[LIMITS + 3])
    _image_axes(axes, view, z, limited_x, limited_y, turned, image)
    xx, xy, yy = LOW_PASS_PX2, 0.0, LOW_PASS_PX2
    for k in range(3):
        xx += image[0, k] * image[0, k]
        xy += image[0, k] * image[1, k]
        yy += image[1, k] * image[1, k]
    u = view[FOCAL] * x_over_z + view[CENTRE]
    v = view[FOCAL + 1] * y_over_z + view[CENTRE + 1]
    # Beyond this many standard deviations alpha is below ALPHA_MIN; 1e-3 px covers float32 rounding.
    reach = math.sqrt(2 * math.log(opacity / ALPHA_MIN))
    reach_x, reach_y = reach * math.sqrt(xx) + 1e-3, reach * math.sqrt(yy) + 1e-3
    x0 = math.ceil(min(max(u - reach_x - 0.5, 0.0), width))
    x1 = math.floor(min(max(u + reach_x - 0.5, -1.0), width - 1.0)) + 1
    y0 = math.ceil(min(max(v - reach_y - 0.5, 0.0), height))
    y1 = math.floor(min(max(v + reach_y - 0.5, -1.0), height - 1.0)) + 1
    if x0 >= x1 or y0 >= y1:
        return z
    determinant = xx * yy - xy * xy
    box[0], box[1], box[2], box[3] = x0, x1, y0, y1
    splat[0], splat[1] = u - x0, v - y0
    splat[2], splat[3], splat[4] = yy / determinant, -xy / determinant, xx / determinant
    splat[5], splat[9] = opacity, z
    return z


@kernel
def project_forward(  # type: ignore[no-untyped-def]
    part, parts, means, quats, scales, opacities, views, width, height, splats, boxes, depths
):
    """Project N Gaussians into V views.

    Args:
        part: Index of the share of the Gaussians to process.
        parts: Number of shares.
        means: Shape [N, 3], float32 [m].
        quats: Shape [N, 4], float32, of any length.
        scales: Shape [N, 3], float32 [m].
        opacities: Shape [N], float32.
        views: Packed cameras, float64, shape [V, VIEW].
        width: Columns of every view [px].
        height: Rows of every view [px].
        splats: Out, float32, shape [V, N, SPLAT]; r, g, b are not changed.
        boxes: Out, int32, shape [V, N, 4]: x0, x1, y0, y1, ends exclusive; zeros if not drawn.
        depths: Out, float64, shape [V, N] [m]: sort key of the splats.
    """
    count = means.shape[0]
    axes, turned, image = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 3))
    for g in range(count * part // parts, count * (part + 1) // parts):
        _rotation(quats[g], axes)
        for i in range(3):
            for k in range(3):
                axes[i, k] *= scales[g, k]
        for v in range(views.shape[0]):
            depths[v, g] = _project_one(
                means[g], float(opacities[g]), views[v], width, height, axes, turned, image, splats[v, g], boxes[v, g]
            )


@kernel
def _project_one_backward(mean, view, splat, grad, axes, turned, image, d_image, d_mean, d_axes):  # type: ignore[no-untyped-def]
    """Add one splat's gradient to the gradients of the Gaussian's mean and axes."""
    x, y, z = _to_camera(mean, view)
    x_over_z, y_over_z = x / z, y / z
    limited_x = min(max(x_over_z, view[LIMITS]), view[LIMITS + 1])
    limited_y = min(max(y_over_z, view[LIMITS + 2]), view[LIMITS + 3])
    _image_axes(axes, view, z, limited_x, limited_y, turned, image)
    xx, xy, yy = float(splat[2]), float(splat[3]), float(splat[4])
    # Covariance: V = -K (dL/dK) K with dL/dK from the moments; then dL/d(image axes) = 2 V image.
    k_xx, k_xy, k_yy = -0.5 * grad[3], -0.5 * grad[4], -0.5 * grad[5]
    left_a, left_b = xx * k_xx + xy * k_xy, xx * k_xy + xy * k_yy
    left_c, left_d = xy * k_xx + yy * k_xy, xy * k_xy + yy * k_yy
    v_xx, v_xy, v_yy = -(left_a * xx + left_b * xy), -(left_a * xy + left_b * yy), -(left_c * xy + left_d * yy)
    scale_x, scale_y = view[FOCAL] / z, view[FOCAL + 1] / z
    d_scale_x = d_scale_y = d_limited_x = d_limited_y = 0.0
    for k in range(3):
        d_x = 2 * (v_xx * image[0, k] + v_xy * image[1, k])
        d_y = 2 * (v_xy * image[0, k] + v_yy * image[1, k])
        d_scale_x += d_x * image[0, k] / scale_x
        d_scale_y += d_y * image[1, k] / scale_y
        d_limited_x -= d_x * scale_x * turned[2, k]
        d_limited_y -= d_y * scale_y * turned[2, k]
        d_image[0, k] = d_x * scale_x
        d_image[1, k] = d_y * scale_y
        d_image[2, k] = -(d_image[0, k] * limited_x + d_image[1, k] * limited_y)
    # Mean: directly in the image, through the Jacobian, and as depth.
    d_x_over_z = view[FOCAL] * (xx * grad[1] + xy * grad[2])
    d_y_over_z = view[FOCAL + 1] * (xy * grad[1] + yy * grad[2])
    if limited_x == x_over_z:
        d_x_over_z += d_limited_x
    if limited_y == y_over_z:
        d_y_over_z += d_limited_y
    d_z = grad[9] - (d_scale_x * scale_x + d_scale_y * scale_y + d_x_over_z * x_over_z + d_y_over_z * y_over_z) / z
    for i in range(3):
        d_mean[i] += (view[i] * d_x_over_z + view[4 + i] * d_y_over_z) / z + view[8 + i] * d_z
        for k in range(3):
            d_axes[i, k] += view[i] * d_image[0, k] + view[4 + i] * d_image[1, k] + view[8 + i] * d_image[2, k]


@kernel
def _quat_backward(d_rotation, inverse, w, x, y, z, d_quat):  # type: ignore[no-untyped-def]
    """Write the gradient of a quaternion of any length from that of its rotation matrix."""
    r = d_rotation
    d_w = 2 * (z * (r[1, 0] - r[0, 1]) + y * (r[0, 2] - r[2, 0]) + x * (r[2, 1] - r[1, 2]))
    d_x = 2 * (y * (r[0, 1] + r[1, 0]) + z * (r[0, 2] + r[2, 0]) + w * (r[2, 1] - r[1, 2]))
    d_x -= 4 * x * (r[1, 1] + r[2, 2])
    d_y = 2 * (x * (r[0, 1] + r[1, 0]) + z * (r[1, 2] + r[2, 1]) + w * (r[0, 2] - r[2, 0]))
    d_y -= 4 * y * (r[0, 0] + r[2, 2])
    d_z = 2 * (x * (r[0, 2] + r[2, 0]) + y * (r[1, 2] + r[2, 1]) + w * (r[1, 0] - r[0, 1]))
    d_z -= 4 * z * (r[0, 0] + r[1, 1])
    along = w * d_w + x * d_x + y * d_y + z * d_z
    d_quat[0] = (d_w - w * along) * inverse
    d_quat[1] = (d_x - x * along) * inverse
    d_quat[2] = (d_y - y * along) * inverse
    d_quat[3] = (d_z - z * along) * inverse


@kernel
def project_backward(  # type: ignore[no-untyped-def]
    part, parts, means, quats, scales, views, splats, boxes, grads, d_means, d_quats, d_scales, d_opacities
):
    """Convert gradients of splats [V, N, SPLAT] to gradients of the Gaussians, summed over views.

    `d_means` is added to; `d_quats`, `d_scales` and `d_opacities` are written.
    """
    count = means.shape[0]
    rotation, axes, d_axes, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    image, d_image, d_mean = np.empty((2, 3)), np.empty((3, 3)), np.empty(3)
    for g in range(count * part // parts, count * (part + 1) // parts):
        inverse, w, x, y, z = _rotation(quats[g], rotation)
        for i in range(3):
            for k in range(3):
                axes[i, k] = rotation[i, k] * scales[g, k]
        d_axes[:] = 0.0
        d_mean[:] = 0.0
        d_opacity = 0.0
        for v in range(views.shape[0]):
            if boxes[v, g, 1] > 0:
                _project_one_backward(
                    means[g], views[v], splats[v, g], grads[v, g], axes, turned, image, d_image, d_mean, d_axes
                )
                d_opacity += grads[v, g, 0] / splats[v, g, 5]
        d_opacities[g] = d_opacity
        for k in range(3):
            d_means[g, k] += d_mean[k]
            d_scales[g, k] = (
                d_axes[0, k] * rotation[0, k] + d_axes[1, k] * rotation[1, k] + d_axes[2, k] * rotation[2, k]
            )
            for i in range(3):
                d_axes[i, k] *= scales[g, k]
        _quat_backward(d_axes, inverse, w, x, y, z, d_quats[g])
