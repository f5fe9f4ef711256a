"""Sensor noise of depth and colour; off by default."""

from __future__ import annotations

import numpy as np

from plop.render.virtual_cameras.texture import seed_from


def add_depth_noise(
    depth_m: np.ndarray, *, noise_m: float, quantization_m: float, dropout: float, seed: tuple[str | int, ...]
) -> np.ndarray:
    """Add noise to a depth image.

    Args:
        depth_m: Shape [H, W], float32 [m]; 0 = not measured.
        noise_m: Standard deviation of Gaussian noise [m].
        quantization_m: Step that depth is rounded to [m]; 0 disables rounding.
        dropout: Probability that a pixel is not measured.
        seed: Identifier of this image; the same seed gives the same noise.

    Returns:
        Shape [H, W], float32 [m]; unmeasured pixels stay unmeasured.
    """
    if not (noise_m or quantization_m or dropout):
        return depth_m
    random = np.random.default_rng(seed_from("depth", *seed))
    measured = depth_m > 0
    out = depth_m + noise_m * random.standard_normal(depth_m.shape)
    if quantization_m:
        out = np.round(out / quantization_m) * quantization_m
    measured &= random.random(depth_m.shape) >= dropout
    return np.where(measured, np.maximum(out, 1e-6), 0).astype(np.float32)


def add_colour_noise(rgb: np.ndarray, *, noise: float, seed: tuple[str | int, ...]) -> np.ndarray:
    """Add noise to a colour image.

    Args:
        rgb: Shape [H, W, 3], uint8.
        noise: Standard deviation of Gaussian noise in each channel, of 255.
        seed: As in `add_depth_noise`.

    Returns:
        Shape [H, W, 3], uint8.
    """
    if not noise:
        return rgb
    random = np.random.default_rng(seed_from("colour", *seed))
    return np.round(rgb + noise * random.standard_normal(rgb.shape)).clip(0, 255).astype(np.uint8)
