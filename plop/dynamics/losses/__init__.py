"""Losses with physical terms."""
