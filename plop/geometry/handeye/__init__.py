"""Hand-eye calibration: solve it, and judge the poses that it is given and the answer."""
