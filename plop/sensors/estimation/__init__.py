"""Estimate the faults of each camera from table and tool."""
