"""Rendering of Gaussians: a rasterizer, scenes, losses, virtual cameras, pictures."""
