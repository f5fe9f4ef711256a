"""Kernels: blend the splats of each tile front to back, and the gradient of that; parallel over tiles.

The state of a tile's pixels is one flat array, one plane after another, so that the innermost loops
run over whole rows of a tile without branches and compile to vector instructions. Indices there are
unsigned because numba's handling of negative ones would keep the loops scalar.
"""

from __future__ import annotations

import numpy as np

from plop.compute.cpu_kernels import kernel
from plop.render.rasterizer.numba_bins import TILE_HEIGHT, TILE_WIDTH
from plop.render.rasterizer.projection import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN

PIXELS = TILE_WIDTH * TILE_HEIGHT
_U = np.uint64
_P1, _P2, _P3, _P4, _P5, _P6, _P7, _P8, _P9 = (_U(plane * PIXELS) for plane in range(1, 10))
_PLANES = 9 * PIXELS
_MAX, _MIN, _LEFT = np.float32(ALPHA_MAX), np.float32(ALPHA_MIN), np.float32(TRANSMITTANCE_MIN)
_0, _1, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_FAR = np.float32(5.6)
"""exp(-5.6) < 1/255: beyond this, splats are ignored."""
_E = tuple(
    np.float32(c)
    for c in (
        3.747888779e-09,
        -2.4309265296e-07,
        1.0130947214e-05,
        -3.25440676e-04,
        7.8124258869e-03,
        -0.1249999742,
        1.0,
    )
)
_E0, _E1, _E2, _E3, _E4, _E5, _E6 = _E
_CHECK_EVERY = 8
"""Number of splats between two checks whether a tile is finished."""


@kernel
def _falloff(exponent):  # type: ignore[no-untyped-def]
    """Return exp(-exponent) for 0 <= exponent <= 5.6: an interpolating polynomial of exp(-e / 8), to the 8th power.

    Relative error below 1e-6 in float32; products and sums only, so that it vectorises.
    """
    p = _E1 + _E0 * exponent
    p = _E2 + p * exponent
    p = _E3 + p * exponent
    p = _E4 + p * exponent
    p = _E5 + p * exponent
    p = _E6 + p * exponent
    p = p * p
    p = p * p
    return p * p


@kernel
def _blend(s, first, last, index, x, y, xx, xy, yy, opacity, red, green, blue, depth):  # type: ignore[no-untyped-def]
    """Blend one splat into pixels first..last of a tile.

    Planes of s: transmittance (negative once finished), sums of r, g, b, depth, 1, pixel x, pixel y, and the
    index of the splat before which the pixel was finished.
    """
    half_xx, half_yy = _HALF * xx, _HALF * yy
    for k in range(_U(first), _U(last)):
        dx = s[k + _P6] - x
        dy = s[k + _P7] - y
        exponent = dx * (half_xx * dx + xy * dy) + half_yy * dy * dy
        alpha = min(opacity * _falloff(exponent), _MAX)
        alpha = alpha if alpha >= _MIN else _0
        alpha = alpha if exponent >= _0 else _0
        alpha = alpha if exponent < _FAR else _0
        before = s[k]
        after = before - before * alpha
        weight = before * alpha if after > _LEFT else _0
        s[k] = after if after > _LEFT else -abs(before)
        s[k + _P8] = index if after > _LEFT else s[k + _P8]
        s[k + _P1] += weight * red
        s[k + _P2] += weight * green
        s[k + _P3] += weight * blue
        s[k + _P4] += weight * depth
        s[k + _P5] += weight


@kernel
def _finished(s):  # type: ignore[no-untyped-def]
    """Return whether all pixels of the tile are finished."""
    most = s[0]
    for k in range(1, PIXELS):
        most = max(most, s[k])
    return most <= _0


@kernel
def _start_tile(s):  # type: ignore[no-untyped-def]
    """Reset a tile's planes: transmittance 1, sums 0, pixel centres relative to the tile's corner."""
    s[:] = _0
    for k in range(PIXELS):
        s[k] = _1
        s[6 * PIXELS + k] = np.float32(k % TILE_WIDTH) + _HALF
        s[7 * PIXELS + k] = np.float32(k // TILE_WIDTH) + _HALF


@kernel
def blend_forward(  # type: ignore[no-untyped-def]
    part, parts, splats, boxes, tile_starts, tile_counts, by_tile, tiles_x, rgb, depth, alpha, left, stop
):
    """Render all tiles of all views.

    Args:
        part: Index of the share of the tiles to process.
        parts: Number of shares; neighbouring tiles are in different ones.
        splats: Shape [V, N, 10].
        boxes: Shape [V, N, 4].
        tile_starts: Where each tile's list starts, shape [V, tiles].
        tile_counts: Length of each tile's list, shape [V, tiles].
        by_tile: Index g of the splat, per tile nearest first.
        tiles_x: Tiles in one row of the image.
        rgb: Out, shape [V, H, W, 3].
        depth: Out, expected depth, shape [V, H, W] [m].
        alpha: Out, shape [V, H, W].
        left: Out, transmittance at the end, shape [V, H, W].
        stop: Out, one more than the last position in the tile's list of a blended splat, [V, H, W].
    """
    views, tiles = tile_starts.shape
    height, width = alpha.shape[1], alpha.shape[2]
    s = np.empty(_PLANES, np.float32)
    for work in range(part, views * tiles, parts):
        v, tile = work // tiles, work % tiles
        corner_x, corner_y = tile % tiles_x * TILE_WIDTH, tile // tiles_x * TILE_HEIGHT
        _start_tile(s)
        for i in range(tile_counts[v, tile]):
            g = by_tile[tile_starts[v, tile] + i]
            p = splats[v, g]
            first = max(boxes[v, g, 2] - corner_y, 0) * TILE_WIDTH
            last = min(boxes[v, g, 3] - corner_y, TILE_HEIGHT) * TILE_WIDTH
            x, y = p[0] + np.float32(boxes[v, g, 0] - corner_x), p[1] + np.float32(boxes[v, g, 2] - corner_y)
            _blend(s, first, last, np.float32(i + 1), x, y, p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9])
            if i % _CHECK_EVERY == _CHECK_EVERY - 1 and _finished(s):
                break
        for row in range(min(TILE_HEIGHT, height - corner_y)):
            for column in range(min(TILE_WIDTH, width - corner_x)):
                k = row * TILE_WIDTH + column
                at_y, at_x = corner_y + row, corner_x + column
                for c in range(3):
                    rgb[v, at_y, at_x, c] = s[(1 + c) * PIXELS + k]
                covered = s[5 * PIXELS + k]
                depth[v, at_y, at_x] = s[4 * PIXELS + k] / max(covered, np.float32(1e-6))
                alpha[v, at_y, at_x] = covered
                left[v, at_y, at_x] = abs(s[k])
                stop[v, at_y, at_x] = s[8 * PIXELS + k]


@kernel
def _blend_backward(s, out, first, last, index, x, y, xx, xy, yy, opacity, red, green, blue, depth):  # type: ignore[no-untyped-def]
    """Remove one splat from pixels first..last of a tile, and write the ten sums of its gradient.

    Planes of s: transmittance behind the splat, gradients of the sums of r, g, b, depth, 1, pixel x,
    pixel y, stop; plane 9 is the value (gradient . colour) of everything behind.
    """
    half_xx, half_yy = _HALF * xx, _HALF * yy
    g_0 = g_x = g_y = g_xx = g_xy = g_yy = g_red = g_green = g_blue = g_depth = _0
    for k in range(_U(first), _U(last)):
        dx = s[k + _P6] - x
        dy = s[k + _P7] - y
        exponent = dx * (half_xx * dx + xy * dy) + half_yy * dy * dy
        raw = opacity * _falloff(exponent)
        alpha = min(raw, _MAX)
        alpha = alpha if alpha >= _MIN else _0
        alpha = alpha if exponent >= _0 else _0
        alpha = alpha if exponent < _FAR else _0
        alpha = alpha if index < s[k + _P8] else _0
        before = s[k] / (_1 - alpha)
        s[k] = before
        d_red, d_green, d_blue, d_depth = s[k + _P1], s[k + _P2], s[k + _P3], s[k + _P4]
        gain = red * d_red + green * d_green + blue * d_blue + depth * d_depth + s[k + _P5] - s[k + _P9]
        s[k + _P9] += alpha * gain
        weight = alpha * before
        g_red += weight * d_red
        g_green += weight * d_green
        g_blue += weight * d_blue
        g_depth += weight * d_depth
        g = weight * gain if raw <= _MAX else _0
        gx = g * dx
        gy = g * dy
        g_0 += g
        g_x += gx
        g_y += gy
        g_xx += gx * dx
        g_xy += gx * dy
        g_yy += gy * dy
    out[0], out[1], out[2], out[3], out[4], out[5] = g_0, g_x, g_y, g_xx, g_xy, g_yy
    out[6], out[7], out[8], out[9] = g_red, g_green, g_blue, g_depth


@kernel
def blend_backward(  # type: ignore[no-untyped-def]
    part,
    parts,
    splats,
    boxes,
    tile_starts,
    by_tile,
    tiles_x,
    depth,
    alpha,
    left,
    stop,
    d_rgb,
    d_depth,
    d_alpha,
    partial,
):
    """Write the gradient of each intersection into `partial`, shape [I, 10], zeros on entry."""
    views, tiles = tile_starts.shape
    height, width = alpha.shape[1], alpha.shape[2]
    s = np.empty(10 * PIXELS, np.float32)
    for work in range(part, views * tiles, parts):
        v, tile = work // tiles, work % tiles
        corner_x, corner_y = tile % tiles_x * TILE_WIDTH, tile // tiles_x * TILE_HEIGHT
        _start_tile(s[:_PLANES])
        s[9 * PIXELS :] = _0
        end = _0
        for row in range(min(TILE_HEIGHT, height - corner_y)):
            for column in range(min(TILE_WIDTH, width - corner_x)):
                k = row * TILE_WIDTH + column
                at_y, at_x = corner_y + row, corner_x + column
                covered = max(alpha[v, at_y, at_x], np.float32(1e-6))
                through = d_depth[v, at_y, at_x] / covered
                s[k] = left[v, at_y, at_x]
                for c in range(3):
                    s[(1 + c) * PIXELS + k] = d_rgb[v, at_y, at_x, c]
                s[4 * PIXELS + k] = through
                s[5 * PIXELS + k] = d_alpha[v, at_y, at_x] - through * depth[v, at_y, at_x]
                s[8 * PIXELS + k] = stop[v, at_y, at_x]
                end = max(end, stop[v, at_y, at_x])
        for i in range(np.int64(end) - 1, -1, -1):
            entry = tile_starts[v, tile] + i
            g = by_tile[entry]
            p = splats[v, g]
            first = max(boxes[v, g, 2] - corner_y, 0) * TILE_WIDTH
            last = min(boxes[v, g, 3] - corner_y, TILE_HEIGHT) * TILE_WIDTH
            x, y = p[0] + np.float32(boxes[v, g, 0] - corner_x), p[1] + np.float32(boxes[v, g, 2] - corner_y)
            _blend_backward(
                s, partial[entry], first, last, np.float32(i), x, y, p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9]
            )
