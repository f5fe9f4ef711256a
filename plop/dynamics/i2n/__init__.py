"""The PLOP model: I2N and what stands around it."""
