"""Building information models."""
