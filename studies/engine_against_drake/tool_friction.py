"""A punch held in a block and moved aside, over friction. Unmaintained."""

# ruff: noqa
# a punch held in a block, moved 3 mm sideways: does the surface follow, and is the force mu N once it slips?
import numpy as np, time
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes.shapes import Shape, whole_body
from plop.physics.scenes.tools import box_mesh

sh = Shape("block", (0.06, 0.04, 0.04))
b = whole_body(sh, 0.005)
for mu in (0.0, 0.3, 0.5, 2.0):
    T = np.arange(0, 31) / 30.0
    z = np.interp(T, [0, 0.2], [0.043, 0.035])
    x = np.interp(T, [0.4, 0.8], [0, 0.008])
    P = np.tile(np.eye(4), (31, 1, 1))
    P[:, 0, 3] = x
    P[:, 2, 3] = z
    t = ToolMotion(*box_mesh((0.026, 0.026, 0.02)), T, P)
    t0 = time.process_time()
    r = simulate(
        b.particles,
        Material(15e3, 0.4, tool_friction=mu, table_friction=2.0, damping_per_s=5),
        t,
        T,
        EngineConfig(dx_m=0.01),
    )
    k = np.argmin(np.linalg.norm(b.particles.positions - [0, 0, 0.04], axis=1))
    f = r.tool_force
    print(
        mu,
        "top moves",
        (1000 * (r.positions[[12, 18, 24, 30], k, 0] - r.positions[0, k, 0])).round(2),
        "ratio Fx/Fz",
        (f[[14, 18, 23], 0] / f[[14, 18, 23], 2]).round(2),
        "Fz",
        f[[11, 23], 2].round(2),
        "cpu",
        round(time.process_time() - t0, 1),
        flush=True,
    )
