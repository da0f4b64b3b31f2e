"""The code that a run is made of, by content."""
