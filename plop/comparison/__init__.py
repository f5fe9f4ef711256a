"""Where and when a model is wrong."""
