"""Learned models of other authors, in our own words: gs-dynamics, DPI-Net, a particle transformer."""
