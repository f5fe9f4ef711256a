"""Kernels: sort splats by depth and list, for every tile of the image, those that reach it.

An intersection is one splat in one tile. Two numberings of them are kept: by tile and depth, for
blending, and by splat, so that gradients are summed without atomics and always in the same order.
"""

from __future__ import annotations

import numpy as np

from plop.compute.cpu_kernels import kernel
from plop.compute.numba_lanes import load, spread, store

TILE_WIDTH = 8
"""Two rows of a tile are one register of sixteen float32 (numba_lanes) [px]."""
TILE_HEIGHT = 16
"""[px]"""
_DIGIT = 11
"""Bits that one pass of the sort by depth looks at; three passes."""


@kernel
def tiles_of(box):  # type: ignore[no-untyped-def]
    """Return the range of tiles (column from, to, row from, to; ends exclusive) that a box of pixels touches."""
    return (
        box[0] // TILE_WIDTH,
        (box[1] + TILE_WIDTH - 1) // TILE_WIDTH,
        box[2] // TILE_HEIGHT,
        (box[3] + TILE_HEIGHT - 1) // TILE_HEIGHT,
    )


@kernel
def _drawn_by_depth(depths, boxes):  # type: ignore[no-untyped-def]
    """List drawn splats nearest first, ties by index: a radix sort of the leading bits of positive float64.

    The keys are the bits above the nearest depth's, 33 of them: where the farthest is twice as far, 1e-10 of a depth.
    """
    order = np.empty(boxes.shape[0], np.int32)
    keys = np.empty(boxes.shape[0], np.int64)
    nearest, farthest, count = np.int64(2**63 - 1), np.int64(0), 0
    for g in range(boxes.shape[0]):
        if boxes[g, 1] > 0:
            order[count] = g
            keys[count] = np.float64(depths[g]).view(np.int64)
            nearest, farthest = min(nearest, keys[count]), max(farthest, keys[count])
            count += 1
    order, keys = order[:count], keys[:count]
    shift = 0
    while (farthest - nearest) >> shift >= 2 ** (3 * _DIGIT):
        shift += 1
    starts = np.zeros((3, 2**_DIGIT + 1), np.int64)
    for i in range(count):
        keys[i] = (keys[i] - nearest) >> shift
        for digit in range(3):
            starts[digit, ((keys[i] >> (digit * _DIGIT)) & (2**_DIGIT - 1)) + 1] += 1
    other_order, other_keys = np.empty_like(order), np.empty_like(keys)
    for digit in range(3):
        for value in range(2**_DIGIT):
            starts[digit, value + 1] += starts[digit, value]
        for i in range(count):
            value = (keys[i] >> (digit * _DIGIT)) & (2**_DIGIT - 1)
            place = starts[digit, value]
            starts[digit, value] = place + 1
            other_order[place] = order[i]
            other_keys[place] = keys[i]
        order, other_order = other_order, order
        keys, other_keys = other_keys, keys
    return order


@kernel
def list_intersections(  # type: ignore[no-untyped-def]
    part, parts, depths, boxes, tiles_x, splat_starts, tile_starts, tile_counts, by_tile, by_splat
):
    """Fill both numberings of the intersections.

    Args:
        part: Index of the share of the views to process.
        parts: Number of shares.
        depths: Shape [V, N] [m].
        boxes: Pixels that each splat can reach, int32, shape [V, N, 4].
        tiles_x: Tiles in one row of the image.
        splat_starts: First intersection of each splat, in the order of the splats, int64, shape [V * N + 1].
        tile_starts: Out, first intersection of each tile, int64, shape [V, tiles].
        tile_counts: Out, number of intersections of each tile, int64, shape [V, tiles].
        by_tile: Out, int32: index g of the splat, per tile nearest first.
        by_splat: Out, int32: position of the same intersection in the order of the splats.
    """
    count = boxes.shape[1]
    for v in range(part, boxes.shape[0], parts):
        cursors = np.zeros(tile_counts.shape[1], np.int64)
        for g in range(count):
            x0, x1, y0, y1 = tiles_of(boxes[v, g])
            for y in range(y0, y1):
                for x in range(x0, x1):
                    cursors[y * tiles_x + x] += 1
        start = splat_starts[v * count]
        for tile in range(len(cursors)):
            tile_starts[v, tile], tile_counts[v, tile] = start, cursors[tile]
            cursors[tile] = start
            start += tile_counts[v, tile]
        for g in _drawn_by_depth(depths[v], boxes[v]):
            x0, x1, y0, y1 = tiles_of(boxes[v, g])
            place = splat_starts[v * count + g]
            for y in range(y0, y1):
                for x in range(x0, x1):
                    cursor = cursors[y * tiles_x + x]
                    cursors[y * tiles_x + x] = cursor + 1
                    by_tile[cursor] = g
                    by_splat[cursor] = place
                    place += 1


@kernel
def sum_by_splat(part, parts, splat_starts, partial, sums):  # type: ignore[no-untyped-def]
    """Sum values of intersections [I, C], numbered by splat, into splats [V, N, C]; shares as in projection."""
    views, count, _ = sums.shape
    for g in range(count * part // parts, count * (part + 1) // parts):
        for v in range(views):
            value = spread(np.float32(0))
            for place in range(splat_starts[v * count + g], splat_starts[v * count + g + 1]):
                value += load(partial[place], 0)
            store(sums[v, g], 0, value)
