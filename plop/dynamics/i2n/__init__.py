"""The PLOP model: I2N and its resampling, features and files."""
