"""Kernels: blend the splats of each tile front to back, and the gradient of that; parallel over tiles.

The state of a tile's pixels is one flat array, one plane after another. Two rows of a tile are one register
(numba_lanes), and a splat is blended into an even number of rows: loops have no branches and no remainders.
"""

from __future__ import annotations

import math

import numpy as np

from plop.compute.cpu_kernels import kernel
from plop.compute.numba_lanes import LANES, load, minus_abs, prefetch, spread, store, totals, where_less
from plop.render.rasterizer.numba_bins import TILE_HEIGHT, TILE_WIDTH
from plop.render.rasterizer.projection import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN

ROWS = TILE_HEIGHT + 2
"""Of a tile's state: splats are blended two rows at a time, so that one row below the tile may be touched."""
PIXELS = TILE_WIDTH * ROWS
_P1, _P2, _P3, _P4, _P5, _P6, _P7, _P8, _P9 = (plane * PIXELS for plane in range(1, 10))
_PLANES = 9 * PIXELS
_MAX, _LEFT = np.float32(ALPHA_MAX), np.float32(TRANSMITTANCE_MIN)
_0, _1, _HALF = np.float32(0), np.float32(1), np.float32(0.5)
_FAR = np.float32(-math.log(ALPHA_MIN))
"""Exponent of the smallest alpha: beyond it, splats are ignored."""
_E0, _E1, _E2, _E3 = (np.float32(c) for c in (3.747888779e-09, -2.4309265296e-07, 1.0130947214e-05, -3.25440676e-04))
_E4, _E5, _E6 = (np.float32(c) for c in (7.8124258869e-03, -0.1249999742, 1.0))
_CHECK_EVERY = 8
"""Number of splats between two checks whether a tile is finished."""


@kernel
def _falloff(exponent):  # type: ignore[no-untyped-def]
    """Return exp(-exponent) for 0 <= exponent <= 5.6: an interpolating polynomial of exp(-e / 8), to the 8th power.

    Relative error below 1e-6 in float32.
    """
    p = spread(_E1) + spread(_E0) * exponent
    p = spread(_E2) + p * exponent
    p = spread(_E3) + p * exponent
    p = spread(_E4) + p * exponent
    p = spread(_E5) + p * exponent
    p = spread(_E6) + p * exponent
    p = p * p
    p = p * p
    return p * p


@kernel
def _blend(s, first, last, index, a_x, a_y, a_0, b_y, b_0, faint, red, green, blue, depth):  # type: ignore[no-untyped-def]
    """Blend one splat into pixels first..last of a tile.

    Planes of s: transmittance (negative once finished), sums of r, g, b, depth, 1, pixel x, pixel y, and the
    index of the splat before which the pixel was finished.
    """
    a_0 = spread(a_0) + spread(a_x) * load(s, _P6)
    a_y, b_y, b_0, faint, index = spread(a_y), spread(b_y), spread(b_0), spread(faint), spread(index)
    red, green, blue, depth = spread(red), spread(green), spread(blue), spread(depth)
    zero, least, most, far = spread(_0), spread(_LEFT), spread(_MAX), spread(_FAR)
    for k in range(first, last, LANES):
        y = load(s, k + _P7)
        a = a_0 + a_y * y
        b = b_0 + b_y * y
        exponent = a * a + (b * b + faint)
        alpha = _falloff(exponent)
        alpha = where_less(alpha, most, alpha, most)
        alpha = where_less(exponent, far, alpha, zero)
        before = load(s, k)
        weight = before * alpha
        after = before - weight
        weight = where_less(least, after, weight, zero)
        store(s, k, where_less(least, after, after, minus_abs(before)))
        store(s, k + _P8, where_less(least, after, index, load(s, k + _P8)))
        store(s, k + _P1, load(s, k + _P1) + weight * red)
        store(s, k + _P2, load(s, k + _P2) + weight * green)
        store(s, k + _P3, load(s, k + _P3) + weight * blue)
        store(s, k + _P4, load(s, k + _P4) + weight * depth)
        store(s, k + _P5, load(s, k + _P5) + weight)


@kernel
def _planes(count):  # type: ignore[no-untyped-def]
    """Allocate planes at a multiple of a register's size, else each register would lie in two cache lines."""
    s = np.empty(count * PIXELS + LANES, np.float32)
    skip = (-s.ctypes.data // 4) % LANES
    return s[skip : skip + count * PIXELS]


@kernel
def _finished(s):  # type: ignore[no-untyped-def]
    """Return whether all pixels of the tile are finished."""
    most = s[0]
    for k in range(1, PIXELS):
        most = max(most, s[k])
    return most <= _0


@kernel
def _start_tile(s, columns, rows):  # type: ignore[no-untyped-def]
    """Reset a tile's planes: transmittance 1 (finished outside the image), sums 0, pixel centres from the corner."""
    s[:] = _0
    for k in range(PIXELS):
        row, column = k // TILE_WIDTH, k % TILE_WIDTH
        s[k] = _1 if row < rows and column < columns else -_1
        s[6 * PIXELS + k] = np.float32(column) + _HALF
        s[7 * PIXELS + k] = np.float32(row) + _HALF


@kernel
def _in_tile(splat, box, corner_x, corner_y):  # type: ignore[no-untyped-def]
    """Return the pixels of a tile's state that a splat reaches, and the splat's exponent in the tile's coordinates.

    The exponent at (x, y) is (a_x x + a_y y + a_0)^2 + (b_y y + b_0)^2: first, last, a_0, b_0 are returned.
    """
    x, y = splat[0] + np.float32(box[0] - corner_x), splat[1] + np.float32(box[2] - corner_y)
    first, last = max(box[2] - corner_y, 0), min(box[3] - corner_y, TILE_HEIGHT)
    first, last = first * TILE_WIDTH, (last + (last - first) % 2) * TILE_WIDTH
    return first, last, -(splat[2] * x + splat[3] * y), -splat[4] * y


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
    s = _planes(9)
    for work in range(part, views * tiles, parts):
        v, tile = work // tiles, work % tiles
        corner_x, corner_y = tile % tiles_x * TILE_WIDTH, tile // tiles_x * TILE_HEIGHT
        columns, rows = min(TILE_WIDTH, width - corner_x), min(TILE_HEIGHT, height - corner_y)
        _start_tile(s, columns, rows)
        for i in range(tile_counts[v, tile]):
            g = by_tile[tile_starts[v, tile] + i]
            p = splats[v, g]
            first, last, a_0, b_0 = _in_tile(p, boxes[v, g], corner_x, corner_y)
            _blend(s, first, last, np.float32(i + 1), p[2], p[3], a_0, p[4], b_0, p[5], p[6], p[7], p[8], p[9])
            if i % _CHECK_EVERY == _CHECK_EVERY - 1 and _finished(s):
                break
        for row in range(rows):
            for column in range(columns):
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
def _blend_backward(s, out, first, last, index, a_x, a_y, a_0, b_y, b_0, faint, red, green, blue, depth):  # type: ignore[no-untyped-def]
    """Remove one splat from pixels first..last of a tile, and write the ten sums of its gradient.

    Planes of s: transmittance behind the splat, gradients of the sums of r, g, b, depth, 1, pixel x,
    pixel y, stop; plane 9 is the value (gradient . colour) of everything behind.
    """
    a_0 = spread(a_0) + spread(a_x) * load(s, _P6)
    a_y, b_y, b_0, faint, index = spread(a_y), spread(b_y), spread(b_0), spread(faint), spread(index)
    red, green, blue, depth = spread(red), spread(green), spread(blue), spread(depth)
    zero, one, most, far = spread(_0), spread(_1), spread(_MAX), spread(_FAR)
    g_0 = g_a = g_b = g_aa = g_ab = g_bb = g_red = g_green = g_blue = g_depth = zero
    for k in range(first, last, LANES):
        y = load(s, k + _P7)
        a = a_0 + a_y * y
        b = b_0 + b_y * y
        exponent = a * a + (b * b + faint)
        raw = _falloff(exponent)
        alpha = where_less(raw, most, raw, most)
        alpha = where_less(exponent, far, alpha, zero)
        alpha = where_less(index, load(s, k + _P8), alpha, zero)
        before = load(s, k) / (one - alpha)
        store(s, k, before)
        d_red, d_green, d_blue, d_depth = load(s, k + _P1), load(s, k + _P2), load(s, k + _P3), load(s, k + _P4)
        behind = load(s, k + _P9)
        gain = red * d_red + green * d_green + blue * d_blue + depth * d_depth + load(s, k + _P5) - behind
        store(s, k + _P9, behind + alpha * gain)
        weight = alpha * before
        g_red += weight * d_red
        g_green += weight * d_green
        g_blue += weight * d_blue
        g_depth += weight * d_depth
        g = where_less(raw, most, weight * gain, zero)
        ga = g * a
        gb = g * b
        g_0 += g
        g_a += ga
        g_b += gb
        g_aa += ga * a
        g_ab += ga * b
        g_bb += gb * b
    store(out, 0, totals((g_0, g_a, g_b, g_aa, g_ab, g_bb, g_red, g_green, g_blue, g_depth)))


@kernel
def blend_backward(  # type: ignore[no-untyped-def]
    part,
    parts,
    splats,
    boxes,
    tile_starts,
    tile_counts,
    by_tile,
    by_splat,
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
    """Write the gradient of each intersection into `partial`, shape [I, LANES], in the order of the splats."""
    views, tiles = tile_starts.shape
    height, width = alpha.shape[1], alpha.shape[2]
    s = _planes(10)
    for work in range(part, views * tiles, parts):
        v, tile = work // tiles, work % tiles
        corner_x, corner_y = tile % tiles_x * TILE_WIDTH, tile // tiles_x * TILE_HEIGHT
        columns, rows = min(TILE_WIDTH, width - corner_x), min(TILE_HEIGHT, height - corner_y)
        _start_tile(s[:_PLANES], columns, rows)
        s[9 * PIXELS :] = _0
        end = _0
        for row in range(rows):
            for column in range(columns):
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
        for i in range(np.int64(end), tile_counts[v, tile]):
            partial[by_splat[tile_starts[v, tile] + i], :] = _0
        for i in range(np.int64(end) - 1, -1, -1):
            entry = tile_starts[v, tile] + i
            g = by_tile[entry]
            p = splats[v, g]
            first, last, a_0, b_0 = _in_tile(p, boxes[v, g], corner_x, corner_y)
            out = partial[by_splat[entry]]
            prefetch(partial[by_splat[max(entry - 2, 0)]], 0)
            _blend_backward(
                s, out, first, last, np.float32(i), p[2], p[3], a_0, p[4], b_0, p[5], p[6], p[7], p[8], p[9]
            )
