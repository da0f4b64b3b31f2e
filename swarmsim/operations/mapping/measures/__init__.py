"""Measures of maps, and of the building they show."""
