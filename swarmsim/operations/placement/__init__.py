"""Where robots ought to be: together, apart, over an area, round a perimeter, in a formation."""
