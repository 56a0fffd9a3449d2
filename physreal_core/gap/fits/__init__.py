"""Fits of a baseline and of candidate effects beside it: unknowns, least squares, screening, starts."""
