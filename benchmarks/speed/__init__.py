"""Speed of single pieces, beside the goals."""
