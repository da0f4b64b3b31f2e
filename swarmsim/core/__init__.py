"""The vocabulary every layer speaks: arrays, seams, the scenario file, names and random streams."""
