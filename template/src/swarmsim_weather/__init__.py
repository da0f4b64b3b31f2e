"""One part for every seam of swarmsim."""
