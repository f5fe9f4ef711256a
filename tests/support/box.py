"""A closed box of twelve triangles, for tools and objects of tests."""

from __future__ import annotations

import numpy as np

BOX_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])[
    :, [[0, 1, 2], [0, 2, 3]]
].reshape(12, 3)
"""Triangles over a box's corners, z fastest, seen from outside counterclockwise."""
