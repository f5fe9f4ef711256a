"""The front door: parse, call, report."""
