"""Reconstruction of a scalar field: robots sample it at their places, and each estimates it everywhere."""
