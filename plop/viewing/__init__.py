"""Show recordings, Gaussians and trajectories in a 3D viewer."""
