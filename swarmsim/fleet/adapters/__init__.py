"""Bodies of robots that exist. Nothing here was tried on hardware."""
