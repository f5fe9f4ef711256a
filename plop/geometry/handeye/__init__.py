"""Hand-eye calibration: solve it, and check the poses and the solution."""
