"""Speed of single components, compared with the goals."""
