"""Reconstruction of a scalar field: robots sample it where they are, and each estimates it everywhere."""
