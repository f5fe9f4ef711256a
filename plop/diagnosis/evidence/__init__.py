"""What is measured, and what of it is chance: residuals, their covariance, and what they say of a response."""
