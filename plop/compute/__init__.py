"""What the machine gives: compiled kernels, threads, devices, memory."""
