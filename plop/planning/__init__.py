"""Which motions to record, and how often, before they are recorded."""
