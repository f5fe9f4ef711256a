"""Virtual RGB-D cameras that record a simulated episode."""
