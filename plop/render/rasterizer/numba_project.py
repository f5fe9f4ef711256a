"""Kernels: project Gaussians to splats, and propagate the gradient of splats back; parallel over Gaussians.

A splat is ten float32: mean x, mean y [px] from the corner of its box of pixels (nearer than the corner of the
image, so finer), a_x, a_y, b_y [1/px], -log(opacity), r, g, b, depth [m]. Its alpha at a distance (dx, dy) from the
mean is exp(-(a^2 + b^2)) times the opacity, with a = a_x dx + a_y dy and b = b_y dy: (a, b) is the Cholesky factor of
half the inverse covariance times the distance. Its gradient arrives as ten sums over pixels of (G, G a, G b, G a^2,
G a b, G b^2, and the gradients of r, g, b, depth), where G = alpha dL/dalpha.
The maths is that of `plop.render.rasterizer.projection`, in float64 within a Gaussian.
"""

from __future__ import annotations

import math

from plop.compute.cpu_kernels import kernel
from plop.render.rasterizer.numba_bins import sum_by_splat, tiles_of
from plop.render.rasterizer.numba_colour import colour_backward, colour_forward
from plop.render.rasterizer.projection import ALPHA_MIN, LOW_PASS_PX2

FAR = -math.log(ALPHA_MIN)
"""Exponent of the smallest alpha."""
SPLAT = 10
"""Numbers per splat and per gradient of a splat."""
POSE, FOCAL, CENTRE, LIMITS, EYE, NEAR, VIEW = 0, 12, 14, 16, 20, 23, 24
"""Offsets in a packed view: cam_from_world (3x4), fx fy, cx cy, Jacobian limits, eye, near plane; its length."""


@kernel
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _times(a, b):  # type: ignore[no-untyped-def]
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@kernel
def _sum(a, factor_a, b, factor_b):  # type: ignore[no-untyped-def]
    """Return factor_a a + factor_b b of two vectors."""
    return (factor_a * a[0] + factor_b * b[0], factor_a * a[1] + factor_b * b[1], factor_a * a[2] + factor_b * b[2])


@kernel
def _vector(values):  # type: ignore[no-untyped-def]
    return (float(values[0]), float(values[1]), float(values[2]))


@kernel
def _rotation(quat):  # type: ignore[no-untyped-def]
    """Return the columns of the rotation matrix of a quaternion of any length, 1 / length and the unit quaternion."""
    w, x, y, z = float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])
    inverse = 1.0 / max(math.sqrt(w * w + x * x + y * y + z * z), 1e-12)
    w, x, y, z = w * inverse, x * inverse, y * inverse, z * inverse
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    third = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    return (first, second, third), inverse, (w, x, y, z)


@kernel
def _image_axes(mean, scale, columns, view):  # type: ignore[no-untyped-def]
    """Project a Gaussian's centre and axes.

    Returns:
        x / z, y / z and z of the centre; the Jacobian times the camera's rotation (two rows) and where it is
        evaluated (x / z, y / z); x and y of the three axes [px].
    """
    to_x, to_y, to_z = _vector(view[0:3]), _vector(view[4:7]), _vector(view[8:11])
    z = _dot(to_z, mean) + view[11]
    inverse = 1 / z
    x_over_z, y_over_z = (_dot(to_x, mean) + view[3]) * inverse, (_dot(to_y, mean) + view[7]) * inverse
    limited_x = min(max(x_over_z, view[LIMITS]), view[LIMITS + 1])
    limited_y = min(max(y_over_z, view[LIMITS + 2]), view[LIMITS + 3])
    scale_x, scale_y = view[FOCAL] * inverse, view[FOCAL + 1] * inverse
    row_x = _sum(to_x, scale_x, to_z, -scale_x * limited_x)
    row_y = _sum(to_y, scale_y, to_z, -scale_y * limited_y)
    first, second, third = columns
    image_x = _times(scale, (_dot(row_x, first), _dot(row_x, second), _dot(row_x, third)))
    image_y = _times(scale, (_dot(row_y, first), _dot(row_y, second), _dot(row_y, third)))
    return (x_over_z, y_over_z, z), (row_x, row_y), (limited_x, limited_y), (image_x, image_y)


@kernel
def _project_one(mean, scale, columns, opacity, view, width, height, splat, box):  # type: ignore[no-untyped-def]
    """Write one splat and the box of pixels (x0, x1, y0, y1) it reaches, empty if not drawn; return its depth."""
    box[:] = 0
    (x_over_z, y_over_z, z), _, _, (image_x, image_y) = _image_axes(mean, scale, columns, view)
    if z <= view[NEAR] or opacity < ALPHA_MIN:
        return z
    xx, xy, yy = LOW_PASS_PX2 + _dot(image_x, image_x), _dot(image_x, image_y), LOW_PASS_PX2 + _dot(image_y, image_y)
    u = view[FOCAL] * x_over_z + view[CENTRE]
    v = view[FOCAL + 1] * y_over_z + view[CENTRE + 1]
    # Beyond this many standard deviations alpha is below ALPHA_MIN; 1e-3 px covers float32 rounding.
    faint = -math.log(opacity)
    reach = 2 * max(FAR - faint, 0.0)
    reach_x, reach_y = math.sqrt(reach * xx) + 1e-3, math.sqrt(reach * yy) + 1e-3
    x0 = math.ceil(min(max(u - reach_x - 0.5, 0.0), width))
    x1 = math.floor(min(max(u + reach_x - 0.5, -1.0), width - 1.0)) + 1
    y0 = math.ceil(min(max(v - reach_y - 0.5, 0.0), height))
    y1 = math.floor(min(max(v + reach_y - 0.5, -1.0), height - 1.0)) + 1
    if x0 >= x1 or y0 >= y1:
        return z
    box[0], box[1], box[2], box[3] = x0, x1, y0, y1
    splat[0], splat[1] = u - x0, v - y0
    to_a = math.sqrt(0.5 / ((xx * yy - xy * xy) * yy))
    splat[2], splat[3], splat[4] = yy * to_a, -xy * to_a, math.sqrt(0.5 / yy)
    splat[5], splat[9] = faint, z
    return z


@kernel
def project_forward(  # type: ignore[no-untyped-def]
    part, parts, means, quats, scales, opacities, sh, views, width, height, splats, boxes, depths, splat_counts
):
    """Project N Gaussians into V views, and find their colours there.

    Args:
        part: Index of the share of the Gaussians to process.
        parts: Number of shares.
        means: Shape [N, 3], float32 [m].
        quats: Shape [N, 4], float32, of any length.
        scales: Shape [N, 3], float32 [m].
        opacities: Shape [N], float32.
        sh: Shape [N, K, 3], float32.
        views: Packed cameras, float64, shape [V, VIEW].
        width: Columns of every view [px].
        height: Rows of every view [px].
        splats: Out, float32, shape [V, N, SPLAT].
        boxes: Out, int32, shape [V, N, 4]: x0, x1, y0, y1, ends exclusive; zeros if not drawn.
        depths: Out, float64, shape [V, N] [m]: sort key of the splats.
        splat_counts: Out, int64, shape [V, N]: number of tiles that each splat can reach.
    """
    count = means.shape[0]
    for g in range(count * part // parts, count * (part + 1) // parts):
        mean, scale, opacity = _vector(means[g]), _vector(scales[g]), float(opacities[g])
        columns, _, _ = _rotation(quats[g])
        for v in range(views.shape[0]):
            depths[v, g] = _project_one(
                mean, scale, columns, opacity, views[v], width, height, splats[v, g], boxes[v, g]
            )
            x0, x1, y0, y1 = tiles_of(boxes[v, g])
            splat_counts[v, g] = (x1 - x0) * (y1 - y0)
    colour_forward(part, parts, means, sh, views, EYE, boxes, splats)


@kernel
def _project_one_backward(mean, scale, columns, view, splat, grad):  # type: ignore[no-untyped-def]
    """Return what one splat adds to the gradients of the Gaussian's mean and three axes."""
    (x_over_z, y_over_z, z), (row_x, row_y), (limited_x, limited_y), (image_x, image_y) = _image_axes(
        mean, scale, columns, view
    )
    a_x, a_y, b_y = float(splat[2]), float(splat[3]), float(splat[4])
    aa, ab, bb = float(grad[3]), float(grad[4]), float(grad[5])
    # Covariance: V = 2 A^T W A, W the second moments of (a, b) = A d; then dL/d(image axes) = 2 V image.
    v_xx = 4 * a_x * a_x * aa
    v_xy = 4 * a_x * (a_y * aa + b_y * ab)
    v_yy = 4 * (a_y * (a_y * aa + 2 * b_y * ab) + b_y * b_y * bb)
    d_x, d_y = _sum(image_x, v_xx, image_y, v_xy), _sum(image_x, v_xy, image_y, v_yy)
    # Mean: directly in the image, through the Jacobian, and as depth.
    to_x, to_y, to_z = _vector(view[0:3]), _vector(view[4:7]), _vector(view[8:11])
    first, second, third = columns
    axes_z = _times(scale, (_dot(to_z, first), _dot(to_z, second), _dot(to_z, third)))
    inverse = 1 / z
    d_x_over_z = view[FOCAL] * 2 * a_x * grad[1]
    d_y_over_z = view[FOCAL + 1] * 2 * (a_y * grad[1] + b_y * grad[2])
    if limited_x == x_over_z:
        d_x_over_z -= view[FOCAL] * inverse * _dot(d_x, axes_z)
    if limited_y == y_over_z:
        d_y_over_z -= view[FOCAL + 1] * inverse * _dot(d_y, axes_z)
    along = _dot(d_x, image_x) + _dot(d_y, image_y) + d_x_over_z * x_over_z + d_y_over_z * y_over_z
    in_image = _sum(to_x, d_x_over_z * inverse, to_y, d_y_over_z * inverse)
    d_mean = _sum(in_image, 1.0, to_z, grad[9] - along * inverse)
    d_axes = (
        _sum(row_x, d_x[0], row_y, d_y[0]),
        _sum(row_x, d_x[1], row_y, d_y[1]),
        _sum(row_x, d_x[2], row_y, d_y[2]),
    )
    return d_mean, d_axes


@kernel
def _quat_backward(d_columns, inverse, quat, d_quat):  # type: ignore[no-untyped-def]
    """Write the gradient of a quaternion of any length from that of its rotation matrix's columns."""
    (r00, r10, r20), (r01, r11, r21), (r02, r12, r22) = d_columns
    w, x, y, z = quat
    d_w = 2 * (z * (r10 - r01) + y * (r02 - r20) + x * (r21 - r12))
    d_x = 2 * (y * (r01 + r10) + z * (r02 + r20) + w * (r21 - r12)) - 4 * x * (r11 + r22)
    d_y = 2 * (x * (r01 + r10) + z * (r12 + r21) + w * (r02 - r20)) - 4 * y * (r00 + r22)
    d_z = 2 * (x * (r02 + r20) + y * (r12 + r21) + w * (r10 - r01)) - 4 * z * (r00 + r11)
    along = w * d_w + x * d_x + y * d_y + z * d_z
    d_quat[0] = (d_w - w * along) * inverse
    d_quat[1] = (d_x - x * along) * inverse
    d_quat[2] = (d_y - y * along) * inverse
    d_quat[3] = (d_z - z * along) * inverse


@kernel
def project_backward(  # type: ignore[no-untyped-def]
    part,
    parts,
    means,
    quats,
    scales,
    opacities,
    sh,
    views,
    splats,
    boxes,
    splat_starts,
    partial,
    grads,
    d_means,
    d_quats,
    d_scales,
    d_opacities,
    d_sh,
):
    """Sum gradients of intersections into those of splats and convert these to gradients of the Gaussians.

    `grads`, shape [V, N, LANES], is written: the gradients of splats. `d_means` and `d_sh` must be zeros.
    """
    sum_by_splat(part, parts, splat_starts, partial, grads)
    colour_backward(part, parts, means, sh, views, EYE, boxes, splats, grads, d_means, d_sh)
    count = means.shape[0]
    zero = (0.0, 0.0, 0.0)
    for g in range(count * part // parts, count * (part + 1) // parts):
        mean, scale = _vector(means[g]), _vector(scales[g])
        columns, inverse, quat = _rotation(quats[g])
        d_mean, d_first, d_second, d_third, d_opacity = zero, zero, zero, zero, 0.0
        for v in range(views.shape[0]):
            if boxes[v, g, 1] > 0:
                of_mean, (first, second, third) = _project_one_backward(
                    mean, scale, columns, views[v], splats[v, g], grads[v, g]
                )
                d_mean = _sum(d_mean, 1.0, of_mean, 1.0)
                d_first = _sum(d_first, 1.0, first, 1.0)
                d_second = _sum(d_second, 1.0, second, 1.0)
                d_third = _sum(d_third, 1.0, third, 1.0)
                d_opacity += grads[v, g, 0] / opacities[g]
        d_opacities[g] = d_opacity
        for k in range(3):
            d_means[g, k] += d_mean[k]
        d_scales[g, 0], d_scales[g, 1] = _dot(d_first, columns[0]), _dot(d_second, columns[1])
        d_scales[g, 2] = _dot(d_third, columns[2])
        turned = (
            _sum(d_first, scale[0], zero, 0.0),
            _sum(d_second, scale[1], zero, 0.0),
            _sum(d_third, scale[2], zero, 0.0),
        )
        _quat_backward(turned, inverse, quat, d_quats[g])
