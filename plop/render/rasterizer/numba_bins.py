"""Kernels: sort splats by depth and list, for every tile of the image, those that reach it.

An intersection is one splat in one tile. Two numberings of them are kept: by tile and depth, for
blending, and by splat, so that gradients are summed without atomics and always in the same order.
"""

from __future__ import annotations

import numpy as np

from plop.compute.cpu_kernels import kernel

TILE_WIDTH = 8
"""One row of a tile is one vector register of eight float32 [px]."""
TILE_HEIGHT = 16
"""[px]"""


@kernel
def _tiles(box):  # type: ignore[no-untyped-def]
    """Return the range of tiles (column from, to, row from, to; ends exclusive) that a box of pixels touches."""
    return (
        box[0] // TILE_WIDTH,
        (box[1] + TILE_WIDTH - 1) // TILE_WIDTH,
        box[2] // TILE_HEIGHT,
        (box[3] + TILE_HEIGHT - 1) // TILE_HEIGHT,
    )


@kernel
def count_intersections(part, parts, boxes, tiles_x, tile_counts, splat_counts):  # type: ignore[no-untyped-def]
    """Count intersections per tile and per splat.

    Args:
        part: Index of the share of the views to process.
        parts: Number of shares.
        boxes: Pixels that each splat can reach, int32, shape [V, N, 4].
        tiles_x: Tiles in one row of the image.
        tile_counts: In and out, int64 zeros, shape [V, tiles].
        splat_counts: Out, int64, shape [V, N].
    """
    for v in range(part, boxes.shape[0], parts):
        for g in range(boxes.shape[1]):
            x0, x1, y0, y1 = _tiles(boxes[v, g])
            splat_counts[v, g] = (x1 - x0) * (y1 - y0)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    tile_counts[v, y * tiles_x + x] += 1


@kernel
def _drawn_by_depth(depths, boxes):  # type: ignore[no-untyped-def]
    """List drawn splats nearest first, ties by index: a radix sort of the leading bits of positive float64.

    The keys resolve depths from 1 mm to 4000 km, to 2e-12 of their value.
    """
    order = np.empty(boxes.shape[0], np.int32)
    keys = np.empty(boxes.shape[0], np.int64)
    nearest = np.float64(2.0**-10).view(np.int64)
    count = 0
    for g in range(boxes.shape[0]):
        if boxes[g, 1] > 0:
            order[count] = g
            bits = np.float64(depths[g]).view(np.int64) - nearest
            keys[count] = min(max(bits, 0) >> 13, 2**44 - 1)  # type: ignore[operator]
            count += 1
    order, keys = order[:count], keys[:count]
    other_order, other_keys = np.empty_like(order), np.empty_like(keys)
    starts = np.empty(2049, np.int64)
    for shift in (0, 11, 22, 33):
        starts[:] = 0
        for i in range(count):
            starts[((keys[i] >> shift) & 2047) + 1] += 1
        for digit in range(2048):
            starts[digit + 1] += starts[digit]
        for i in range(count):
            digit = (keys[i] >> shift) & 2047
            other_order[starts[digit]] = order[i]
            other_keys[starts[digit]] = keys[i]
            starts[digit] += 1
        order, other_order = other_order, order
        keys, other_keys = other_keys, keys
    return order


@kernel
def list_intersections(part, parts, depths, boxes, tiles_x, tile_starts, splat_starts, by_tile, by_splat):  # type: ignore[no-untyped-def]
    """Fill both numberings of the intersections.

    Args:
        part: Index of the share of the views to process.
        parts: Number of shares.
        depths: Shape [V, N] [m].
        boxes: Shape [V, N, 4].
        tiles_x: Tiles in one row of the image.
        tile_starts: First intersection of each tile, int64, shape [V, tiles].
        splat_starts: First position of each splat in `by_splat`, int64, shape [V, N].
        by_tile: Out, int32: index g of the splat, per tile nearest first.
        by_splat: Out, int32: position in `by_tile`, per splat.
    """
    for v in range(part, boxes.shape[0], parts):
        cursors = tile_starts[v].copy()
        for g in _drawn_by_depth(depths[v], boxes[v]):
            x0, x1, y0, y1 = _tiles(boxes[v, g])
            place = splat_starts[v, g]
            for y in range(y0, y1):
                for x in range(x0, x1):
                    cursor = cursors[y * tiles_x + x]
                    cursors[y * tiles_x + x] = cursor + 1
                    by_tile[cursor] = g
                    by_splat[place] = cursor
                    place += 1


@kernel
def sum_by_splat(part, parts, splat_starts, splat_counts, by_splat, partial, sums):  # type: ignore[no-untyped-def]
    """Sum values of intersections [I, C], numbered by tile, into splats [V, N, C]; shares as in projection."""
    views, count, channels = sums.shape
    for g in range(count * part // parts, count * (part + 1) // parts):
        for v in range(views):
            sums[v, g, :] = 0
            for place in range(splat_starts[v, g], splat_starts[v, g] + splat_counts[v, g]):
                for c in range(channels):
                    sums[v, g, c] += partial[by_splat[place], c]
