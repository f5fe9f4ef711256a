"""Calibrate cameras: boards, bundle adjustment, clocks, and whether their depth agrees."""
