"""Use of the machine: compiled kernels, threads, devices, memory."""
