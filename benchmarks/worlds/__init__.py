"""Foreign worlds: other simulators that make plop's raw recordings."""
