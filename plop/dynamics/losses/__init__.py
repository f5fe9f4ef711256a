"""Losses that know some physics."""
