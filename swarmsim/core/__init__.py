"""The vocabulary of all layers: arrays, seams, the scenario file, names and random streams."""
