"""Stage `repair`."""
