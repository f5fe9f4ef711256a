"""The 90 % band around a prediction: spread of an ensemble, conformal width, and scores on held-out episodes."""
