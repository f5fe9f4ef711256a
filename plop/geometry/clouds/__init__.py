"""Point clouds: from depth, registered, fused, segmented."""
