"""Robots take places: together, apart, over an area, round a perimeter, in a formation."""
