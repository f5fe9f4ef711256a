"""Compiled kernels on disk are valid for exactly these sources."""

from __future__ import annotations

from plop.physics import grid, jit, tool_contact, toughness, transfer


def test_every_kernel_is_stamped_with_all_sources():
    kernels = [transfer.stress_p2g, transfer.add_chunks, transfer.g2p, grid.grid_velocities, tool_contact.mark_sides,
               tool_contact.table_gaps, tool_contact.push_tool, toughness.resist_cut]  # fmt: skip
    assert all(k._cache._cache_file._source_stamp[-1] == jit._SOURCES for k in kernels)
