"""Errors with heavy tails: what a model is off by differs from episode to episode."""

FREEDOM = 4.0
"""Degrees of freedom (Student's t) of noise and of what an episode is off by: few enough for a part that breaks loose,
and for one motion that goes wrong; the variance is finite."""
