"""What is measured of maps, and of the building that they are of."""
