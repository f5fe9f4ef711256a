"""A grid around the particles, and the transfers between both."""
