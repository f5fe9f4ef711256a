"""Faults of sensors, one file each."""
