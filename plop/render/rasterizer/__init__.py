"""Render Gaussians: one interface; numba on the CPU, gsplat on CUDA, plain torch as the reference."""
