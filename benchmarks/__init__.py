"""Measurements, run by hand."""

import plop as plop  # before torch: it says how torch's threads wait
