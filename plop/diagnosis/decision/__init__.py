"""From scores to a verdict: amplitudes with intervals, limits, the decision, and its words."""
