"""Compiled kernels on disk are valid for exactly the sources they came from."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from plop.compute.kernel_cache import sources_digest
from plop.physics.effects import adhesion
from plop.physics.engine import grid, tool_contact, toughness, transfer
from plop.render import rasterize_numba_blend, rasterize_numba_project

ROOT = Path(__file__).parents[2]
KERNEL = """
from {origin} import kernel
from constants import FACTOR

{decorator}
def scaled(x):
    return FACTOR * x
"""


def stamp(dispatcher) -> tuple:
    return dispatcher._cache._cache_file._source_stamp


def test_every_kernel_is_stamped_with_the_sources_it_may_use():
    engine, effects, render = (
        sources_digest(ROOT / "plop" / f) for f in ("physics/engine", "physics/effects", "render")
    )
    for kernel in (
        transfer.stress_p2g,
        transfer.add_chunks,
        transfer.g2p,
        grid.grid_velocities,
        tool_contact.mark_sides,
        tool_contact.table_gaps,
        tool_contact.push_tool,
        toughness.resist_cut,
    ):
        assert stamp(kernel)[1:] == (engine,)
    assert stamp(adhesion.stick)[1:] == (effects, engine)
    assert stamp(rasterize_numba_project.project_forward)[1:] == (render,)
    assert stamp(rasterize_numba_blend.blend_forward)[1:] == (render,)


def test_a_changed_constant_of_another_file_is_not_missed(tmp_path: Path):
    # Python's own cache of byte code looks at times in whole seconds
    env = {"PYTHONPATH": f"{ROOT}:{tmp_path}", "PYTHONDONTWRITEBYTECODE": "1"}

    def run(origin: str, decorator: str, factor: float) -> list[float]:
        (tmp_path / "constants.py").write_text(f"FACTOR = {factor}\n")
        module = tmp_path / f"{origin.replace('.', '_')}.py"
        if not module.exists():
            module.write_text(KERNEL.format(origin=origin, decorator=decorator))
        code = f"import {module.stem} as m; print(m.scaled(2.0), sum(m.scaled.stats.cache_hits.values()))"
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
        )
        return [float(word) for word in done.stdout.split()]

    for origin, decorator in (("plop.compute.cpu_kernels", "@kernel"), ("plop.physics.engine.jit", "@kernel()")):
        assert run(origin, decorator, 3.0) == [6.0, 0]
        assert run(origin, decorator, 3.0) == [6.0, 1]
        assert run(origin, decorator, 5.0) == [10.0, 0]
