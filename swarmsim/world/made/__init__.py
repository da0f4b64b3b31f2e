"""Buildings that are generated."""
