"""The kernels of the time step, compiled by numba."""
