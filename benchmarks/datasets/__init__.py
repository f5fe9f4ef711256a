"""Accuracy on recorded data sets."""
