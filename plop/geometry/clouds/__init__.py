"""Point clouds: from depth, registered, fused, and what lies in them."""
