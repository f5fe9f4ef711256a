"""Gaussians and what is seen of them: a rasterizer, scenes, losses, virtual cameras, pictures."""
